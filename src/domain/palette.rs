//! One version of a box's colour samples. A version never changes; a new one replaces it.

use serde::{Deserialize, Serialize};

use super::boxes::BoxTool;
use super::files::annotations::AnnotationsFile;
use super::named;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::advice::{PairAdvice, TapeAdvice, TapeRanking};
use crate::vision::segmentation::palette::confusion::{Confusion, LabelConfusion};
use crate::vision::segmentation::palette::light::LightCondition;
use crate::vision::segmentation::palette::verdict::{MIN_SHOWN_STEPS, TapeProblem};
use crate::vision::segmentation::palette::{FalseArea, Margin, PaletteGrade, TapeVerdict, verdict};
use crate::vision::space::Pixel;
use crate::vision::still::StillShaft;
use crate::vision::surroundings::Surroundings;

/// Colour samples to be stored as a box's next version.
#[derive(Clone, Debug, PartialEq)]
pub struct NewPalette {
    /// The instructor's marks.
    pub annotations: AnnotationsFile,
    /// The tools that the marks name, with their sizes.
    pub tools: Vec<BoxTool>,
    /// Number of samples for each label.
    pub counts: Vec<LabelCount>,
    /// The samples themselves, in the form that the tracker reads back; opaque to the store.
    pub samples: Vec<u8>,
    /// How well the colours can be relied on.
    pub report: PaletteReport,
    /// What stands still in the marked pictures; `None` if they are too small.
    pub surroundings: Option<Surroundings>,
}

/// Number of colour samples for a label.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LabelCount {
    /// Marker's name, or `background`, `shaft`, …
    pub label: String,
    /// Pixels sampled.
    pub samples: u64,
}

/// A preview of what marks would do on frames, before colours are learned from them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PalettePreview {
    /// The colours of tapes and of bare shafts, in the order of the masks' classes.
    pub colours: Vec<String>,
    /// A mask for each frame, in the order they were sent.
    pub frames: Vec<FrameMask>,
    /// The shaft of each tool without tape on each frame, or why there is none: frame by frame, then in the tools' order.
    pub shafts: Vec<ShaftOnFrame>,
    /// The report that these colours would get once learned.
    #[serde(flatten)]
    pub report: PaletteReport,
}

/// The cells of a frame that have the colour of a tape or of a bare shaft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FrameMask {
    /// The frame.
    pub frame: u64,
    /// Columns of the frame, pixels.
    pub width: u32,
    /// Rows of the frame, pixels.
    pub height: u32,
    /// Side of a cell, pixels; the tracker samples each cell once.
    pub cell_px: u32,
    /// Cells in a row.
    pub columns: u32,
    /// Rows of cells.
    pub rows: u32,
    /// The cells, row by row, as runs of `[class, cells]`: class 0 is neither, 1 the first of `colours`, and so on.
    pub runs: Vec<[u32; 2]>,
}

/// A tool's bare shaft on a frame that is looked at alone, without a camera. Places are `[x, y]`, pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ShaftOnFrame {
    /// The frame.
    pub frame: u64,
    /// The tool's name.
    pub tool: String,
    /// Both edges, each from the picture's rim to the shaft's end, or to the last place that shows both; `null` if they
    /// were not found.
    pub edges_px: Option<[[[f64; 2]; 2]; 2]>,
    /// Share of the edges that shows a step of the colour, 0..1: of the edge that shows less.
    pub edges_shown: Option<f64>,
    /// Where the shaft's middle ends; `null` if that is hidden or not clear.
    pub end_px: Option<[f64; 2]>,
    /// Why the edges or the end are missing; `null` if both were found.
    pub reason: Option<String>,
}

impl ShaftOnFrame {
    /// From what was measured.
    pub fn new(frame: u64, tool: &str, measured: Result<StillShaft, MissReason>) -> Self {
        let place = |pixel: Pixel| [pixel.u(), pixel.v()];
        let shaft = measured.ok();
        let end_px = shaft.and_then(|shaft| shaft.end).map(place);
        let reason = measured.map_or_else(Some, |_| end_px.is_none().then_some(MissReason::TipHidden));
        Self {
            frame,
            tool: tool.to_owned(),
            edges_px: shaft.map(|shaft| shaft.borders.map(|border| border.map(place))),
            edges_shown: shaft.map(|shaft| shaft.shown),
            end_px,
            reason: reason.map(|reason| reason.name().to_owned()),
        }
    }
}

/// How well a palette's colours can be relied on, determined before anything is recorded.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PaletteReport {
    /// The class given to each label's marked pixels when samples from their own rectangle are excluded.
    pub confusion: Vec<ConfusionRow>,
    /// Each tool's colour, in the tools' order.
    pub verdicts: Vec<ColourVerdict>,
    /// A line for each colour that is not good, with the reason.
    pub warnings: Vec<String>,
}

/// Classification of one label's pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ConfusionRow {
    /// Marker's name, or `background`, `shaft`, …
    pub label: String,
    /// Number of marked rectangles; with only one, its own pixels vote for each other and the shares are too
    /// optimistic.
    pub rectangles: u64,
    /// Number of pixels classified.
    pub pixels: u64,
    /// Shares in each light: as marked, and in changed light.
    pub lights: Vec<LightShares>,
}

/// Classification of one label's pixels in one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LightShares {
    /// `as marked`, `30 % darker`, `30 % brighter`, `500 K warmer`, `500 K cooler`.
    pub light: String,
    /// Share classified as no tool, 0..1.
    pub no_tool: f64,
    /// Share classified as each tool, 0..1; together with `no_tool` they add up to 1.
    pub tools: Vec<ToolShare>,
}

/// Share of pixels classified as a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ToolShare {
    /// Marker's name.
    pub tool: String,
    /// 0..1.
    pub share: f64,
}

/// Suitable tapes for a box, from a picture of it without tools: every tape and every pair, best first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PaletteAdvice {
    /// Every tape.
    pub tapes: Vec<TapeGrade>,
    /// Every pair, for two tools.
    pub pairs: Vec<PairGrade>,
    /// A line for each tape that should not be used.
    pub warnings: Vec<String>,
}

/// How well one tape suits a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TapeGrade {
    /// The colour's name on the roll.
    pub tape: String,
    /// The nearest RAL Classic shade.
    pub ral: u16,
    /// That shade as `#rrggbb`.
    pub srgb: String,
    /// Colour shift that the tape tolerates before the box's colours are nearer, steps of 1/255 of the full range.
    pub margin_steps: f64,
    /// Share of the picture that has its colour, 0..1.
    pub in_box: f64,
    /// The resulting grade.
    pub grade: ColourGrade,
}

/// How well two tapes suit a box and differ from each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PairGrade {
    /// The tapes.
    pub tapes: [String; 2],
    /// The smallest of `apart_steps` and both tapes' own margins, steps.
    pub margin_steps: f64,
    /// Colour shift that either tape tolerates before the other is nearer, steps.
    pub apart_steps: f64,
    /// The resulting grade.
    pub grade: ColourGrade,
}

named! {
    /// How well a colour can be relied on.
    ColourGrade: "colour grade" {
        /// Recognised in every light tried, and nothing else is taken for it.
        Good = "good",
        /// Fails in another light, or nearly fails in this one.
        AtRisk = "at_risk",
        /// Fails in the light that it was marked in.
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
    /// Reasons against it, worst first.
    pub reasons: Vec<String>,
    /// The same reasons in parts, for pages in other languages; empty for versions learned before they were kept.
    #[serde(default)]
    pub causes: Vec<ColourCause>,
    /// Distance of its colour from other marked colours; absent where nothing else or only one pixel was marked.
    pub margin: Option<ColourMargin>,
    /// Area of its colour outside its band, in the worst marked frame; absent where its band was not found.
    pub false_area: Option<ColourFalseArea>,
}

named! {
    /// What is wrong with a colour.
    ColourFault: "colour fault" {
        /// No rectangle marks it.
        NotMarked = "not_marked",
        /// Only one rectangle marks it.
        MarkedOnce = "marked_once",
        /// Part of its own tape is not recognised.
        Lost = "lost",
        /// One of its rectangles has another colour than the others.
        OddRectangle = "odd_rectangle",
        /// Part of something else is mistaken for it.
        Taken = "taken",
        /// It overlaps with another colour.
        Overlap = "overlap",
        /// A small shift turns it into another colour.
        Thin = "thin",
        /// A region outside its band has its colour.
        FalseRegion = "false_region",
    }
}

/// A reason against a colour, in parts. Parts that the fault does not have are `null`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ColourCause {
    /// What is wrong.
    pub fault: ColourFault,
    /// Share of the pixels that it is about, 0..1.
    pub share: Option<f64>,
    /// The other label.
    pub label: Option<String>,
    /// The light, as in the confusion; `null`: as marked.
    pub light: Option<String>,
    /// The frame.
    pub frame: Option<u64>,
    /// Place in the frame, pixels.
    pub at: Option<[u64; 2]>,
    /// The margin and the colour's own spread, in steps of 1/255 of the full range.
    pub steps: Option<[f64; 2]>,
    /// Area of the largest false region, as a multiple of the band's.
    pub largest_of_band: Option<f64>,
}

/// Distance of a colour from the others, in steps of 1/255 of the full range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ColourMargin {
    /// The shift that all but 5 % of its pixels tolerate before another label is nearer; negative: another is nearer
    /// already.
    pub margin_steps: f64,
    /// RMS distance of its pixels from their mean.
    pub spread_steps: f64,
    /// The nearest label.
    pub nearest: String,
}

/// The area of a frame that has a tool's colour and is not the tool.
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
    pub fn new(confusion: &Confusion, verdicts: &[TapeVerdict], false_areas: &[FalseArea]) -> Self {
        let verdict = |(verdict, margin): (&TapeVerdict, &Option<Margin>)| ColourVerdict {
            tool: verdict.tool.clone(),
            grade: verdict.grade.into(),
            reasons: verdict.causes.iter().map(|(_, cause)| cause.to_string()).collect(),
            causes: verdict.causes.iter().map(|(_, cause)| cause.into()).collect(),
            margin: margin.as_ref().map(Into::into),
            false_area: verdict::worst(false_areas, &verdict.tool).map(Into::into),
        };
        Self {
            confusion: confusion.rows.iter().map(|row| confusion_row(row, &confusion.tools)).collect(),
            verdicts: verdicts.iter().zip(&confusion.margins).map(verdict).collect(),
            warnings: verdicts.iter().filter_map(TapeVerdict::warning).collect(),
        }
    }
}

impl PaletteReport {
    /// All numbers apart from counts.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let lights = self.confusion.iter().flat_map(|row| &row.lights);
        let shares = lights.flat_map(|light| light.tools.iter().map(|of| of.share).chain([light.no_tool]));
        let margins = self.verdicts.iter().filter_map(|of| of.margin.as_ref());
        let areas = self.verdicts.iter().filter_map(|of| of.false_area.as_ref());
        let causes = self.verdicts.iter().flat_map(|of| &of.causes).flat_map(ColourCause::numbers);
        let of_margins = margins.flat_map(|margin| [margin.margin_steps, margin.spread_steps]);
        shares.chain(of_margins).chain(areas.flat_map(|area| [area.share, area.largest_of_band])).chain(causes)
    }

    /// All texts.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let lights = self.confusion.iter().flat_map(|row| &row.lights);
        let in_lights = lights.flat_map(|light| light.tools.iter().map(|of| &of.tool).chain([&light.light]));
        let labels = self.confusion.iter().map(|row| &row.label);
        let texts = labels.chain(in_lights).chain(self.verdicts.iter().flat_map(verdict_texts)).chain(&self.warnings);
        texts.map(String::as_str)
    }
}

impl From<&TapeRanking> for PaletteAdvice {
    fn from(advice: &TapeRanking) -> Self {
        let bad = advice.tapes.iter().filter(|tape| tape.grade == PaletteGrade::Bad);
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
    /// All numbers.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let tapes = self.tapes.iter().flat_map(|tape| [tape.margin_steps, tape.in_box]);
        tapes.chain(self.pairs.iter().flat_map(|pair| [pair.margin_steps, pair.apart_steps]))
    }

    /// All texts.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let tapes = self.tapes.iter().flat_map(|tape| [&tape.tape, &tape.srgb]);
        tapes.chain(self.pairs.iter().flat_map(|pair| &pair.tapes)).chain(&self.warnings).map(String::as_str)
    }
}

fn verdict_texts(verdict: &ColourVerdict) -> impl Iterator<Item = &String> {
    let of_causes = verdict.causes.iter().flat_map(|cause| cause.label.iter().chain(&cause.light));
    let nearest = verdict.margin.as_ref().map(|margin| &margin.nearest);
    verdict.reasons.iter().chain([&verdict.tool]).chain(nearest).chain(of_causes)
}

fn confusion_row(row: &LabelConfusion, tools: &[String]) -> ConfusionRow {
    let tool_share = |(tool, share): (&String, &f64)| ToolShare { tool: tool.clone(), share: *share };
    let shares = |(light, shares): (LightCondition, &Vec<f64>)| LightShares {
        light: light.name().to_owned(),
        no_tool: shares[0],
        tools: tools.iter().zip(&shares[1..]).map(tool_share).collect(),
    };
    ConfusionRow {
        label: row.label.clone(),
        rectangles: row.rectangles as u64,
        pixels: row.test_pixels as u64,
        lights: LightCondition::ALL.into_iter().zip(&row.shares).map(shares).collect(),
    }
}

impl From<PaletteGrade> for ColourGrade {
    fn from(grade: PaletteGrade) -> Self {
        match grade {
            PaletteGrade::Good => Self::Good,
            PaletteGrade::AtRisk => Self::AtRisk,
            PaletteGrade::Bad => Self::Bad,
        }
    }
}

impl ColourCause {
    fn of(fault: ColourFault) -> Self {
        let (share, label, light, frame) = (None, None, None, None);
        Self { fault, share, label, light, frame, at: None, steps: None, largest_of_band: None }
    }

    fn numbers(&self) -> impl Iterator<Item = f64> + use<> {
        self.share.into_iter().chain(self.steps.into_iter().flatten()).chain(self.largest_of_band)
    }
}

impl From<&TapeProblem> for ColourCause {
    fn from(problem: &TapeProblem) -> Self {
        let in_light = |light: &LightCondition| (*light != LightCondition::AsMarked).then(|| light.name().to_owned());
        match problem {
            TapeProblem::NotMarked => Self::of(ColourFault::NotMarked),
            TapeProblem::MarkedOnce => Self::of(ColourFault::MarkedOnce),
            TapeProblem::Lost { share, to, light } => {
                Self { share: Some(*share), label: to.clone(), light: in_light(light), ..Self::of(ColourFault::Lost) }
            }
            TapeProblem::OddRectangle { share, at } => Self {
                share: Some(*share),
                frame: Some(at.frame),
                at: Some([at.x as u64, at.y as u64]),
                ..Self::of(ColourFault::OddRectangle)
            },
            TapeProblem::Taken { share, from, light } => Self {
                share: Some(*share),
                label: Some(from.clone()),
                light: in_light(light),
                ..Self::of(ColourFault::Taken)
            },
            TapeProblem::Thin(Margin { margin_steps, spread_steps, nearest }) => Self {
                label: Some(nearest.clone()),
                steps: Some([*margin_steps, *spread_steps]),
                ..Self::of(if *margin_steps < MIN_SHOWN_STEPS { ColourFault::Overlap } else { ColourFault::Thin })
            },
            TapeProblem::FalseRegion(FalseArea { frame, share, largest_of_band, .. }) => Self {
                share: Some(*share),
                frame: Some(*frame),
                largest_of_band: Some(*largest_of_band),
                ..Self::of(ColourFault::FalseRegion)
            },
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::segmentation::samples::RectanglePlace;

    #[test]
    fn a_reason_in_parts_says_what_its_sentence_says() {
        let (share, light, nearest) = (0.5, LightCondition::Darker, "cyan".to_owned());
        let thin =
            |margin_steps| TapeProblem::Thin(Margin { margin_steps, spread_steps: 3.0, nearest: nearest.clone() });
        let area = FalseArea { tool: "red".into(), frame: 7, share, largest_of_band: 0.7 };
        let problems = [
            TapeProblem::NotMarked,
            TapeProblem::MarkedOnce,
            TapeProblem::Lost { share, to: Some(nearest.clone()), light },
            TapeProblem::OddRectangle { share, at: RectanglePlace { frame: 7, x: 30, y: 40 } },
            TapeProblem::Taken { share, from: nearest.clone(), light: LightCondition::AsMarked },
            thin(-1.0),
            thin(2.0),
            TapeProblem::FalseRegion(area),
        ];
        let causes: Vec<ColourCause> = problems.iter().map(ColourCause::from).collect();
        assert!(
            causes.iter().map(|cause| cause.fault).eq(ColourFault::ALL.iter().copied()),
            "each fault once, in order"
        );
        assert_eq!((causes[2].label.as_deref(), causes[2].light.as_deref()), (Some("cyan"), Some("30 % darker")));
        assert_eq!((causes[3].frame, causes[3].at), (Some(7), Some([30, 40])));
        assert_eq!((causes[4].share, &causes[4].light), (Some(share), &None), "the light was as marked");
        assert_eq!((causes[6].steps, causes[7].largest_of_band), (Some([2.0, 3.0]), Some(0.7)));
    }
}
