//! One version of a box's colour samples: never changed, only followed by the next.

use serde::{Deserialize, Serialize};

use super::boxes::BoxTool;
use super::files::annotations::AnnotationsFile;
use super::named;
use crate::pipeline::segmentation::palette::advice::{Advice, PairAdvice, TapeAdvice};
use crate::pipeline::segmentation::palette::confusion::{Confusion, Row};
use crate::pipeline::segmentation::palette::light::Light;
use crate::pipeline::segmentation::palette::{FalseArea, Grade, Margin, Verdict, verdict};

/// Colour samples to be stored as a box's next version.
#[derive(Clone, Debug, PartialEq)]
pub struct NewPalette {
    /// What the instructor marked.
    pub annotations: AnnotationsFile,
    /// The tools that it names, with their sizes.
    pub tools: Vec<BoxTool>,
    /// How many samples each label gave.
    pub counts: Vec<LabelCount>,
    /// The samples themselves, in the form that the tracker reads back; opaque to the store.
    pub samples: Vec<u8>,
    /// What they are worth.
    pub report: PaletteReport,
}

/// How many colour samples a label gave.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LabelCount {
    /// Marker's name, or `background`, `shaft`, …
    pub label: String,
    /// Pixels sampled.
    pub samples: u64,
}

/// What marks would make of frames, before anything is learned from them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PalettePreview {
    /// The colours of tape, in the order in which masks count them.
    pub colours: Vec<String>,
    /// A mask for each frame, in the order in which they were sent.
    pub frames: Vec<FrameMask>,
    /// What the colours are worth, as it would be told of them once they are learned.
    #[serde(flatten)]
    pub report: PaletteReport,
}

/// What of a frame the tracker takes for tape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FrameMask {
    /// Which frame.
    pub frame: u64,
    /// Columns of the frame, pixels.
    pub width: u32,
    /// Rows of the frame, pixels.
    pub height: u32,
    /// A cell's side, pixels: the tracker looks once at each.
    pub cell_px: u32,
    /// Cells in a row.
    pub columns: u32,
    /// Rows of cells.
    pub rows: u32,
    /// The cells, row by row, as runs of `[class, cells]`: class 0 is no tape, 1 the first of `colours`, and so on.
    pub runs: Vec<[u32; 2]>,
}

/// What a palette's colours are worth: found before anything is recorded.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PaletteReport {
    /// What the marked pixels of each label are taken for when their own rectangle has no say.
    pub confusion: Vec<ConfusionRow>,
    /// Each tool's colour, in the tools' order.
    pub verdicts: Vec<ColourVerdict>,
    /// A line for each colour that is not good: what speaks against it.
    pub warnings: Vec<String>,
}

/// What one label's pixels are taken for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ConfusionRow {
    /// Marker's name, or `background`, `shaft`, …
    pub label: String,
    /// Rectangles that were marked; with only one, its own pixels vote for each other and the shares flatter.
    pub rectangles: u64,
    /// Pixels asked about.
    pub pixels: u64,
    /// Shares in each light: as marked, and when it changes.
    pub lights: Vec<LightShares>,
}

/// What one label's pixels are taken for in one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LightShares {
    /// `as marked`, `30 % darker`, `30 % brighter`, `500 K warmer`, `500 K cooler`.
    pub light: String,
    /// Share taken for no tool, 0..1.
    pub no_tool: f64,
    /// Share taken for each tool, 0..1; with `no_tool` they add up to 1.
    pub tools: Vec<ToolShare>,
}

/// A share of pixels that is taken for a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ToolShare {
    /// Marker's name.
    pub tool: String,
    /// 0..1.
    pub share: f64,
}

/// Which tapes suit a box, by a picture of it without tools: every tape and every pair, best first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PaletteAdvice {
    /// Every tape.
    pub tapes: Vec<TapeGrade>,
    /// Every pair, for two tools.
    pub pairs: Vec<PairGrade>,
    /// A line for each tape that is not to be taken.
    pub warnings: Vec<String>,
}

/// One tape against a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TapeGrade {
    /// The colour's name on the roll.
    pub tape: String,
    /// The RAL Classic shade that is nearest.
    pub ral: u16,
    /// That shade as `#rrggbb`.
    pub srgb: String,
    /// Shift of colour that it stands before the box's colours are nearer, steps of 1/255 of the full range.
    pub margin_steps: f64,
    /// Share of the picture that has its colour, 0..1.
    pub in_box: f64,
    /// What that means.
    pub grade: ColourGrade,
}

/// Two tapes against a box and each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PairGrade {
    /// The tapes.
    pub tapes: [String; 2],
    /// The least of what they are apart and of both tapes' own margins, steps.
    pub margin_steps: f64,
    /// Shift of colour that either stands before the other is nearer, steps.
    pub apart_steps: f64,
    /// What that means.
    pub grade: ColourGrade,
}

named! {
    /// How well a colour can be relied on.
    ColourGrade: "colour grade" {
        /// Known as itself in every light tried, and nothing else is taken for it.
        Good = "good",
        /// Fails in another light, or nearly fails in this one.
        AtRisk = "at_risk",
        /// Fails in the light in which it was marked.
        Bad = "bad",
    }
}

/// How well a tool's colour can be relied on, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ColourVerdict {
    /// Marker's name.
    pub tool: String,
    /// Good, at risk or bad.
    pub grade: ColourGrade,
    /// What speaks against it, worst first.
    pub reasons: Vec<String>,
    /// How far its colour is from what else was marked; absent where nothing else or only one pixel was.
    pub margin: Option<ColourMargin>,
    /// What of the marked frames has its colour outside its band, worst frame; absent where its band was not found.
    pub false_area: Option<ColourFalseArea>,
}

/// How far a colour is from the others, in steps of 1/255 of the full range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ColourMargin {
    /// The shift that all but 5 % of its pixels stand before another label is nearer; negative: it is already.
    pub margin_steps: f64,
    /// RMS distance of its pixels from their mean.
    pub spread_steps: f64,
    /// The label that is nearest.
    pub nearest: String,
}

/// What of a frame has a tool's colour and is not the tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ColourFalseArea {
    /// The frame.
    pub frame: u64,
    /// Share of the frame outside the band, 0..1.
    pub share: f64,
    /// Area of the largest such region, as a multiple of the band's.
    pub largest_of_band: f64,
}

impl PaletteReport {
    /// From the pipeline's findings.
    pub fn new(confusion: &Confusion, verdicts: &[Verdict], false_areas: &[FalseArea]) -> Self {
        let verdict = |(verdict, margin): (&Verdict, &Option<Margin>)| ColourVerdict {
            tool: verdict.tool.clone(),
            grade: verdict.grade.into(),
            reasons: verdict.causes.iter().map(|(_, cause)| cause.to_string()).collect(),
            margin: margin.as_ref().map(Into::into),
            false_area: verdict::worst(false_areas, &verdict.tool).map(Into::into),
        };
        Self {
            confusion: confusion.rows.iter().map(|row| confusion_row(row, &confusion.tools)).collect(),
            verdicts: verdicts.iter().zip(&confusion.margins).map(verdict).collect(),
            warnings: verdicts.iter().filter_map(Verdict::warning).collect(),
        }
    }
}

impl PaletteReport {
    /// Every number that can be other than a count.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let lights = self.confusion.iter().flat_map(|row| &row.lights);
        let shares = lights.flat_map(|light| light.tools.iter().map(|of| of.share).chain([light.no_tool]));
        let margins = self.verdicts.iter().filter_map(|of| of.margin.as_ref());
        let areas = self.verdicts.iter().filter_map(|of| of.false_area.as_ref());
        let of_margins = margins.flat_map(|margin| [margin.margin_steps, margin.spread_steps]);
        shares.chain(of_margins).chain(areas.flat_map(|area| [area.share, area.largest_of_band]))
    }

    /// Every text.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let lights = self.confusion.iter().flat_map(|row| &row.lights);
        let in_lights = lights.flat_map(|light| light.tools.iter().map(|of| &of.tool).chain([&light.light]));
        let labels = self.confusion.iter().map(|row| &row.label);
        let texts = labels.chain(in_lights).chain(self.verdicts.iter().flat_map(texts_of)).chain(&self.warnings);
        texts.map(String::as_str)
    }
}

impl From<&Advice> for PaletteAdvice {
    fn from(advice: &Advice) -> Self {
        let bad = advice.tapes.iter().filter(|tape| tape.grade == Grade::Bad);
        let warning = |TapeAdvice { tape, in_box, .. }: &TapeAdvice| {
            format!("Do not take {}: {:.2} % of this picture has its colour.", tape.name, 100.0 * in_box)
        };
        Self {
            tapes: advice.tapes.iter().map(TapeGrade::from).collect(),
            pairs: advice.pairs.iter().map(PairGrade::from).collect(),
            warnings: bad.map(warning).collect(),
        }
    }
}

impl From<&TapeAdvice> for TapeGrade {
    fn from(&TapeAdvice { tape, margin_steps, in_box, grade }: &TapeAdvice) -> Self {
        Self { tape: tape.name.to_owned(), ral: tape.ral, srgb: tape.hex(), margin_steps, in_box, grade: grade.into() }
    }
}

impl From<&PairAdvice> for PairGrade {
    fn from(&PairAdvice { tapes, apart_steps, margin_steps, grade }: &PairAdvice) -> Self {
        Self { tapes: tapes.map(|tape| tape.name.to_owned()), margin_steps, apart_steps, grade: grade.into() }
    }
}

impl PaletteAdvice {
    /// Every number.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let tapes = self.tapes.iter().flat_map(|tape| [tape.margin_steps, tape.in_box]);
        tapes.chain(self.pairs.iter().flat_map(|pair| [pair.margin_steps, pair.apart_steps]))
    }

    /// Every text.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let tapes = self.tapes.iter().flat_map(|tape| [&tape.tape, &tape.srgb]);
        tapes.chain(self.pairs.iter().flat_map(|pair| &pair.tapes)).chain(&self.warnings).map(String::as_str)
    }
}

fn texts_of(verdict: &ColourVerdict) -> impl Iterator<Item = &String> {
    verdict.reasons.iter().chain([&verdict.tool]).chain(verdict.margin.as_ref().map(|margin| &margin.nearest))
}

fn confusion_row(row: &Row, tools: &[String]) -> ConfusionRow {
    let tool_share = |(tool, share): (&String, &f64)| ToolShare { tool: tool.clone(), share: *share };
    let shares = |(light, shares): (Light, &Vec<f64>)| LightShares {
        light: light.name().to_owned(),
        no_tool: shares[0],
        tools: tools.iter().zip(&shares[1..]).map(tool_share).collect(),
    };
    ConfusionRow {
        label: row.label.clone(),
        rectangles: row.rectangles as u64,
        pixels: row.asked as u64,
        lights: Light::ALL.into_iter().zip(&row.shares).map(shares).collect(),
    }
}

impl From<Grade> for ColourGrade {
    fn from(grade: Grade) -> Self {
        match grade {
            Grade::Good => Self::Good,
            Grade::AtRisk => Self::AtRisk,
            Grade::Bad => Self::Bad,
        }
    }
}

impl From<&Margin> for ColourMargin {
    fn from(margin: &Margin) -> Self {
        let Margin { margin_steps, spread_steps, nearest } = margin.clone();
        Self { margin_steps, spread_steps, nearest }
    }
}

impl From<&FalseArea> for ColourFalseArea {
    fn from(area: &FalseArea) -> Self {
        Self { frame: area.frame, share: area.share, largest_of_band: area.largest_of_band }
    }
}
