//! Good, at risk or bad: judges each tool's colour from the confusion and the false regions.

use std::fmt;

use super::confusion::Confusion;
use super::light::LightCondition;
use super::margin::Margin;
use crate::vision::segmentation::samples::{ColourSamples, RectanglePlace};

// The limits lie between two measured cases: scenes that are tracked well (the rendered scenes V1–V5, clips at 720p
// and 1080p, the simulator's vivid tapes), and purple tape blended, step by step, into the purple of a simulated mat.

/// Shares of a tape's pixels that are not recognised: at risk from the first on, bad from the second on. Well-tracked
/// tapes lose at most 2.3 % in the marked light, and 24 % in 30 % less light (V1's orange, half in shadow).
const LOST_SHARES: [f64; 2] = [0.15, 0.40];

/// Share of a rectangle's pixels that its tape's other rectangles do not recognise: from here on, the rectangle is
/// named. A rectangle twice as wide and as high as the tape shows three quarters of something else, one that lies half
/// beside it one half.
const ODD_RECTANGLE_SHARE: f64 = 0.45;

/// Shares of another label's pixels that are classified as the tape: at risk from the first on, bad from the second
/// on. Well-tracked tapes: at most 2.0 % in the marked light (jaws, where they meet the band), 3.0 % in other light.
/// One background rectangle of 16 is 6 %.
const TAKEN_SHARES: [f64; 2] = [0.05, 0.20];

/// Margins of a tape, steps: at risk below the first, bad below the second. Purple was tracked wrongly, by more than
/// 90 mm, at 0.9, 1.8 and 2.2, and well from 2.8 on; the scenes' tapes have 5.8 to 23.
pub const MARGIN_STEPS: [f64; 2] = [4.0, 2.5];
/// A smaller margin would be shown as 0 steps. The margin of colours that overlap is negative.
pub const MIN_SHOWN_STEPS: f64 = 0.05;

/// Area of the largest false region, as a share of the band's: at risk from the first on, bad from the second on.
/// Purple was tracked wrongly from 3.7 on; well-tracked tapes have at most 0.08.
pub const FALSE_REGION: [f64; 2] = [0.2, 0.5];

/// How reliable a colour is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PaletteGrade {
    /// Recognised as itself, and nothing else is classified as it, in every light tried.
    Good,
    /// Fails in another light, or nearly fails in the marked light.
    AtRisk,
    /// Fails in the marked light.
    Bad,
}

impl PaletteGrade {
    /// The grade of a margin, steps: at risk below the first limit, bad below the second.
    pub(super) fn of_margin(margin_steps: f64, [risk, bad]: [f64; 2]) -> Self {
        match margin_steps {
            margin if margin < bad => PaletteGrade::Bad,
            margin if margin < risk => PaletteGrade::AtRisk,
            _ => PaletteGrade::Good,
        }
    }
}

/// Judgement of one tool's colour.
#[derive(Clone, Debug, PartialEq)]
pub struct TapeVerdict {
    /// The tool.
    pub tool: String,
    /// The worst grade among its causes; good if there are none.
    pub grade: PaletteGrade,
    /// The problems found, worst first.
    pub causes: Vec<(PaletteGrade, TapeProblem)>,
}

/// One problem of a colour. Shares are 0..1.
#[derive(Clone, Debug, PartialEq)]
pub enum TapeProblem {
    /// No rectangle marks it.
    NotMarked,
    /// Only one rectangle marks it, so there is nothing independent to test it with.
    MarkedOnce,
    /// Part of its own tape is not recognised.
    Lost {
        /// Share of its pixels.
        share: f64,
        /// The other tool that most of them are classified as, if it takes more than half.
        to: Option<String>,
        /// The light.
        light: LightCondition,
    },
    /// One of its rectangles has another colour than the others.
    OddRectangle {
        /// Share of the rectangle's pixels that the others do not recognise.
        share: f64,
        /// Where the rectangle is.
        at: RectanglePlace,
    },
    /// Part of something else is classified as its tape.
    Taken {
        /// Share of the other label's pixels.
        share: f64,
        /// The other label.
        from: String,
        /// The light.
        light: LightCondition,
    },
    /// The margin between its colour and another label's is thin.
    Thin(Margin),
    /// A region outside its band has its colour.
    FalseRegion(FalseArea),
}

/// Area of a frame that has a tool's colour but is not the tool.
#[derive(Clone, Debug, PartialEq)]
pub struct FalseArea {
    /// The tool.
    pub tool: String,
    /// The frame.
    pub frame: u64,
    /// Share of the frame outside the band that has the tool's colour.
    pub share: f64,
    /// Area of the largest such region, as a multiple of the band's; above 1 it is larger than the band.
    pub largest_of_band: f64,
}

/// Judges every tool from the marked colours alone; one verdict per tool, in their order. A colour that was not marked
/// shows only on a frame: [`judge`] takes that into account.
pub fn verdicts(samples: &ColourSamples, tools: &[String]) -> Vec<TapeVerdict> {
    judge(&Confusion::of(samples, tools), &[])
}

/// Judges every tool from its confusion and from the false areas; one verdict per tool, in their order.
pub fn judge(confusion: &Confusion, false_areas: &[FalseArea]) -> Vec<TapeVerdict> {
    (0..confusion.tools.len()).map(|tool| verdict(confusion, tool, false_areas)).collect()
}

/// The frame with the largest false region of a tool's colour.
pub fn worst<'a>(false_areas: &'a [FalseArea], tool: &str) -> Option<&'a FalseArea> {
    let of_tool = false_areas.iter().filter(|area| area.tool == tool);
    of_tool.max_by(|a, b| a.largest_of_band.total_cmp(&b.largest_of_band))
}

fn verdict(confusion: &Confusion, tool: usize, false_areas: &[FalseArea]) -> TapeVerdict {
    let name = &confusion.tools[tool];
    let mut causes: Vec<(PaletteGrade, TapeProblem)> = match confusion.row_of(tool) {
        None => vec![(PaletteGrade::Bad, TapeProblem::NotMarked)],
        Some(row) if row.rectangles == 1 => vec![(PaletteGrade::AtRisk, TapeProblem::MarkedOnce)],
        Some(_) => Vec::new(),
    };
    causes.extend(odd_rectangle(confusion, tool));
    causes.extend(lost(confusion, tool));
    causes.extend(taken(confusion, tool));
    causes.extend(thin(confusion, tool));
    causes.extend(false_region(worst(false_areas, name)));
    causes.sort_by_key(|(grade, _)| std::cmp::Reverse(*grade));
    let grade = causes.first().map_or(PaletteGrade::Good, |(grade, _)| *grade);
    TapeVerdict { tool: name.clone(), grade, causes }
}

/// Is too little of its own tape recognised? Tested in the marked light, else in the worst other.
fn lost(confusion: &Confusion, tool: usize) -> Option<(PaletteGrade, TapeProblem)> {
    let row = confusion.row_of(tool)?;
    worst_light(LOST_SHARES, |light| 1.0 - row.taken_for(tool, light)).map(|(grade, share, light)| {
        let others = (0..confusion.tools.len()).filter(|other| *other != tool);
        let to = others.max_by(|a, b| row.taken_for(*a, light).total_cmp(&row.taken_for(*b, light)));
        let to = to.filter(|other| row.taken_for(*other, light) > 0.5 * share);
        (grade, TapeProblem::Lost { share, to: to.map(|other| confusion.tools[other].clone()), light })
    })
}

/// Does one of its rectangles have another colour than the others? Such a rectangle alone does not make a colour bad,
/// because the others outvote it.
fn odd_rectangle(confusion: &Confusion, tool: usize) -> Option<(PaletteGrade, TapeProblem)> {
    let (number, share) = confusion.row_of(tool)?.oddest.filter(|(_, share)| *share >= ODD_RECTANGLE_SHARE)?;
    let at = *confusion.places.get(number as usize)?;
    Some((PaletteGrade::AtRisk, TapeProblem::OddRectangle { share, at }))
}

/// Every other label with too many pixels classified as this tool.
fn taken(confusion: &Confusion, tool: usize) -> impl Iterator<Item = (PaletteGrade, TapeProblem)> {
    confusion.rows.iter().filter(move |row| row.tool != Some(tool)).filter_map(move |row| {
        let (grade, share, light) = worst_light(TAKEN_SHARES, |light| row.taken_for(tool, light))?;
        Some((grade, TapeProblem::Taken { share, from: row.label.clone(), light }))
    })
}

fn thin(confusion: &Confusion, tool: usize) -> Option<(PaletteGrade, TapeProblem)> {
    let margin = confusion.margins[tool].as_ref()?;
    let grade = PaletteGrade::of_margin(margin.margin_steps, MARGIN_STEPS);
    (grade != PaletteGrade::Good).then(|| (grade, TapeProblem::Thin(margin.clone())))
}

fn false_region(area: Option<&FalseArea>) -> Option<(PaletteGrade, TapeProblem)> {
    let grade = above(FALSE_REGION, area?.largest_of_band, LightCondition::AsMarked)?;
    Some((grade, TapeProblem::FalseRegion(area?.clone())))
}

/// The grade of a share in its worst light; the marked light comes before any other.
fn worst_light(limits: [f64; 2], share: impl Fn(LightCondition) -> f64) -> Option<(PaletteGrade, f64, LightCondition)> {
    let found = LightCondition::ALL.map(|light| (above(limits, share(light), light), share(light), light));
    let worst = found.into_iter().filter_map(|(grade, share, light)| Some((grade?, share, light)));
    worst.reduce(|a, b| if (b.0, b.1) > (a.0, a.1) && a.2 != LightCondition::AsMarked { b } else { a })
}

/// Grade of a share in a light. In another light than the marked one it is at risk at most, because that light may
/// never occur.
fn above([risk, bad]: [f64; 2], share: f64, light: LightCondition) -> Option<PaletteGrade> {
    match light {
        LightCondition::AsMarked if share >= bad => Some(PaletteGrade::Bad),
        LightCondition::AsMarked => (share >= risk).then_some(PaletteGrade::AtRisk),
        _ => (share >= bad).then_some(PaletteGrade::AtRisk),
    }
}

impl TapeVerdict {
    /// Summary of the problems in one line; `None` if the colour is good.
    pub fn warning(&self) -> Option<String> {
        let causes: Vec<String> = self.causes.iter().map(|(_, cause)| cause.to_string()).collect();
        (self.grade != PaletteGrade::Good)
            .then(|| format!("the colour `{}` is {}: {}", self.tool, self.grade.name(), causes.join("; ")))
    }
}

impl PaletteGrade {
    /// Human-readable name.
    pub fn name(self) -> &'static str {
        match self {
            PaletteGrade::Good => "good",
            PaletteGrade::AtRisk => "at risk",
            PaletteGrade::Bad => "bad",
        }
    }
}

impl fmt::Display for TapeProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        match self {
            TapeProblem::NotMarked => f.write_str("no rectangle marks it"),
            TapeProblem::MarkedOnce => {
                f.write_str("only one rectangle marks it, so it cannot be tested; mark it on three frames or more")
            }
            TapeProblem::Lost { share, to, light } => {
                write!(f, "{} of its own tape is not recognised", percent(*share))?;
                if let Some(tool) = to {
                    write!(f, ", most of that is mistaken for `{tool}`")?;
                }
                in_light(*light, f)
            }
            TapeProblem::OddRectangle { share, at: RectanglePlace { frame, .. } } => write!(
                f,
                "{} of a mark on frame {} has another colour than its other marks: it also holds something beside the \
                 tape; mark only tape there",
                percent(*share),
                frame + 1 // people count frames from 1
            ),
            TapeProblem::Taken { share, from, light } => {
                write!(f, "{} of `{from}` is mistaken for it", percent(*share))?;
                in_light(*light, f)
            }
            TapeProblem::Thin(Margin { margin_steps, nearest, .. }) if *margin_steps < MIN_SHOWN_STEPS => {
                write!(
                    f,
                    "its colour overlaps with that of `{nearest}`: a mark may also hold what lies around the tape, such as \
                     the mat; mark inside its edges"
                )
            }
            TapeProblem::Thin(Margin { margin_steps, spread_steps, nearest }) => write!(
                f,
                "its colour hardly differs from `{nearest}` (by {margin_steps:.1} of 255 steps, while it varies by \
                 {spread_steps:.1}): if a mark also holds what lies around the tape, such as the mat, mark inside its \
                 edges; otherwise use a tape of another colour",
            ),
            TapeProblem::FalseRegion(FalseArea { frame, share, largest_of_band, .. }) => write!(
                f,
                "on frame {}, {:.2} % of the picture outside its band has its colour, the largest region \
                 {largest_of_band:.1} × the band",
                frame + 1,
                100.0 * share
            ),
        }
    }
}

fn in_light(light: LightCondition, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    match light {
        LightCondition::AsMarked => Ok(()),
        other => write!(f, " when the light is {}", other.name()),
    }
}
