//! Good, at risk or bad: what the confusion and the false regions mean for a recording, tool by tool.

use std::fmt;

use super::confusion::Confusion;
use super::light::Light;
use super::margin::Margin;
use crate::pipeline::segmentation::samples::ColourSamples;

// The limits stand between what was measured on scenes that are tracked well (the rendered scenes V1–V5, clips at 720p and
// 1080p, the simulator's vivid tapes) and on purple tape that is blended, step by step, into the purple of a simulated mat.

/// Share of a tape's pixels not known as its own from which it is at risk, and from which it is bad. Well-tracked tapes lose at
/// most 2.3 % as marked, and 24 % in 30 % less light (V1's orange, half in shadow).
const LOST: [f64; 2] = [0.15, 0.40];

/// Share of another label's pixels taken for the tape from which it is at risk, and from which it is bad. Well-tracked: at
/// most 2.0 % as marked (jaws, where they meet the band), 3.0 % in other light. One background rectangle of 16 is 6 %.
const TAKEN: [f64; 2] = [0.05, 0.20];

/// Margin below which a tape is at risk, and below which it is bad, steps. Purple was followed wrongly, by more than 90 mm, at
/// 0.9, 1.8 and 2.2; tracked well at 2.8 and beyond; the scenes' tapes have 5.8 to 23.
pub const MARGIN_STEPS: [f64; 2] = [4.0, 2.5];

/// Largest false region, as a share of the band's area, from which a colour is at risk, and from which it is bad. Purple was
/// followed wrongly at 3.7 and more; well-tracked tapes have at most 0.08.
pub const FALSE_REGION: [f64; 2] = [0.2, 0.5];

/// How well a colour can be relied on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Grade {
    /// Known as itself, and nothing else is taken for it, in every light tried.
    Good,
    /// Fails in another light, or nearly fails in this one.
    AtRisk,
    /// Fails in the light in which it was marked.
    Bad,
}

/// What was found about one tool's colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The tool.
    pub tool: String,
    /// The worst of its causes; good where there is none.
    pub grade: Grade,
    /// What is wrong, worst first.
    pub causes: Vec<(Grade, Cause)>,
}

/// One thing that is wrong with a colour. Shares are 0..1.
#[derive(Clone, Debug, PartialEq)]
pub enum Cause {
    /// No rectangle marks it.
    NotMarked,
    /// Only one rectangle marks it: nothing independent to judge it by.
    MarkedOnce,
    /// Its own tape is not known as such.
    Lost {
        /// Share of its pixels.
        share: f64,
        /// The other tool that takes most of them, if one takes the greater part.
        to: Option<String>,
        /// In which light.
        light: Light,
    },
    /// Something else is taken for it.
    Taken {
        /// Share of the other label's pixels.
        share: f64,
        /// The other label.
        from: String,
        /// In which light.
        light: Light,
    },
    /// Its colour is hardly apart from another label's.
    Thin(Margin),
    /// A region outside its band has its colour.
    FalseRegion(FalseArea),
}

/// What of a frame has a tool's colour and is not the tool.
#[derive(Clone, Debug, PartialEq)]
pub struct FalseArea {
    /// The tool.
    pub tool: String,
    /// The frame.
    pub frame: u64,
    /// Share of the frame outside the band that has the tool's colour.
    pub share: f64,
    /// Area of the largest such region, as a multiple of the band's; more than 1 is larger than the band.
    pub largest_of_band: f64,
}

/// Judges every tool by the marked colours alone, one verdict a tool, in their order. A colour that nobody marked shows only
/// on a frame: [`judge`] takes that into account.
pub fn verdicts(samples: &ColourSamples, tools: &[String]) -> Vec<Verdict> {
    judge(&Confusion::of(samples, tools), &[])
}

/// Judges every tool by its confusion and by what was seen outside its band; one verdict a tool, in their order.
pub fn judge(confusion: &Confusion, false_areas: &[FalseArea]) -> Vec<Verdict> {
    (0..confusion.tools.len()).map(|tool| verdict(confusion, tool, false_areas)).collect()
}

/// The frame on which the most of a tool's colour was seen in one place outside its band.
pub fn worst<'a>(false_areas: &'a [FalseArea], tool: &str) -> Option<&'a FalseArea> {
    let of_tool = false_areas.iter().filter(|area| area.tool == tool);
    of_tool.max_by(|a, b| a.largest_of_band.total_cmp(&b.largest_of_band))
}

fn verdict(confusion: &Confusion, tool: usize, false_areas: &[FalseArea]) -> Verdict {
    let name = &confusion.tools[tool];
    let mut causes: Vec<(Grade, Cause)> = match confusion.row_of(tool) {
        None => vec![(Grade::Bad, Cause::NotMarked)],
        Some(row) if row.rectangles == 1 => vec![(Grade::AtRisk, Cause::MarkedOnce)],
        Some(_) => Vec::new(),
    };
    causes.extend(lost(confusion, tool));
    causes.extend(taken(confusion, tool));
    causes.extend(thin(confusion, tool));
    causes.extend(false_region(worst(false_areas, name)));
    causes.sort_by_key(|(grade, _)| std::cmp::Reverse(*grade));
    let grade = causes.first().map_or(Grade::Good, |(grade, _)| *grade);
    Verdict { tool: name.clone(), grade, causes }
}

/// Its own tape that is not known: in the marked light, else in the worst other.
fn lost(confusion: &Confusion, tool: usize) -> Option<(Grade, Cause)> {
    let row = confusion.row_of(tool)?;
    worst_light(LOST, |light| 1.0 - row.taken_for(tool, light)).map(|(grade, share, light)| {
        let others = (0..confusion.tools.len()).filter(|other| *other != tool);
        let to = others.max_by(|a, b| row.taken_for(*a, light).total_cmp(&row.taken_for(*b, light)));
        let to = to.filter(|other| row.taken_for(*other, light) > 0.5 * share);
        (grade, Cause::Lost { share, to: to.map(|other| confusion.tools[other].clone()), light })
    })
}

/// Each other label of which too much is taken for it.
fn taken(confusion: &Confusion, tool: usize) -> impl Iterator<Item = (Grade, Cause)> {
    confusion.rows.iter().filter(move |row| row.tool != Some(tool)).filter_map(move |row| {
        let (grade, share, light) = worst_light(TAKEN, |light| row.taken_for(tool, light))?;
        Some((grade, Cause::Taken { share, from: row.label.clone(), light }))
    })
}

fn thin(confusion: &Confusion, tool: usize) -> Option<(Grade, Cause)> {
    let margin = confusion.margins[tool].as_ref()?;
    let [risk, bad] = MARGIN_STEPS;
    let grade = if margin.margin_steps < bad { Grade::Bad } else { Grade::AtRisk };
    (margin.margin_steps < risk).then(|| (grade, Cause::Thin(margin.clone())))
}

fn false_region(area: Option<&FalseArea>) -> Option<(Grade, Cause)> {
    let grade = above(FALSE_REGION, area?.largest_of_band, Light::AsMarked)?;
    Some((grade, Cause::FalseRegion(area?.clone())))
}

/// What a share means in the light in which it is worst, the marked light before any other.
fn worst_light(limits: [f64; 2], share: impl Fn(Light) -> f64) -> Option<(Grade, f64, Light)> {
    let found = Light::ALL.map(|light| (above(limits, share(light), light), share(light), light));
    let worst = found.into_iter().filter_map(|(grade, share, light)| Some((grade?, share, light)));
    worst.reduce(|a, b| if (b.0, b.1) > (a.0, a.1) && a.2 != Light::AsMarked { b } else { a })
}

/// Another light than the marked one puts at risk at most: it may never come.
fn above([risk, bad]: [f64; 2], share: f64, light: Light) -> Option<Grade> {
    match light {
        Light::AsMarked if share >= bad => Some(Grade::Bad),
        Light::AsMarked => (share >= risk).then_some(Grade::AtRisk),
        _ => (share >= bad).then_some(Grade::AtRisk),
    }
}

impl Verdict {
    /// What speaks against the colour, in a line; `None` where it is good.
    pub fn warning(&self) -> Option<String> {
        let causes: Vec<String> = self.causes.iter().map(|(_, cause)| cause.to_string()).collect();
        (self.grade != Grade::Good)
            .then(|| format!("the colour `{}` is {}: {}", self.tool, self.grade.name(), causes.join("; ")))
    }
}

impl Grade {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Grade::Good => "good",
            Grade::AtRisk => "at risk",
            Grade::Bad => "bad",
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        match self {
            Cause::NotMarked => f.write_str("no rectangle marks it"),
            Cause::MarkedOnce => {
                f.write_str("only one rectangle marks it, so nothing can vouch for it; mark it on three frames or more")
            }
            Cause::Lost { share, to, light } => {
                write!(f, "{} of its own tape is not known as such", percent(*share))?;
                if let Some(tool) = to {
                    write!(f, ", most of that taken for `{tool}`")?;
                }
                in_light(*light, f)
            }
            Cause::Taken { share, from, light } => {
                write!(f, "{} of `{from}` is taken for it", percent(*share))?;
                in_light(*light, f)
            }
            Cause::Thin(Margin { margin_steps, spread_steps, nearest }) => write!(
                f,
                "a shift of {:.1} of 255 steps turns it into `{nearest}`, and its own pixels spread over {spread_steps:.1}",
                margin_steps.max(0.0) // a negative one: what is nearer already needs no shift
            ),
            Cause::FalseRegion(FalseArea { frame, share, largest_of_band, .. }) => write!(
                f,
                "on frame {frame}, {:.2} % of the picture outside its band has its colour, the largest region {largest_of_band:.1} × the band",
                100.0 * share
            ),
        }
    }
}

fn in_light(light: Light, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    match light {
        Light::AsMarked => Ok(()),
        other => write!(f, " when the light is {}", other.name()),
    }
}
