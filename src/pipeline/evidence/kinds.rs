//! The kind of stretch that each feature has: one table that names every feature.

use super::movements::{Measure, Way};
use super::seconds::{Between, Second};
use super::{Adds, Cause, Question, absences, bursts, movements, rests, seconds};
use crate::pipeline::features::motion::Motion;
use crate::pipeline::features::pauses::Tier;
use crate::pipeline::features::spectrum::TREMOR_HZ;
use crate::pipeline::features::{FeatureSettings, FeatureValue};

/// How to find the stretches of a feature with this measured value on these motions, the tool's own first. `None` if
/// the feature has no stretches, because the whole task contributes alike.
pub(super) fn question<'a>(
    value: &FeatureValue,
    measured: f64,
    motions: &[&Motion],
    settings: &'a FeatureSettings,
) -> Option<Question<'a>> {
    let own = *motions.first()?;
    let (seen_s, task_s) = (own.observed_s(), own.interval.steps() as f64 * own.step_s);
    let trocar = own.known.fulcrum;
    let idle = |steps: i64| rests::is_pause(steps, settings);
    let tier = |tier: Tier, adds: Adds| {
        rests::of_tool(motions, settings, false, |steps| Tier::of(steps, settings) == tier, adds)
    };
    let detours = |way: Way, adds: Adds| movements::detours(motions, settings, way, adds);
    let worst = |measure: Measure| movements::worst(motions, settings, measure, measured);
    let second = |by: Second| seconds::of_tool(motions, settings, by);
    let absent = |cause: Option<Cause>, adds: Adds| absences::of_tool(motions, settings, cause, adds);
    let (in_all, of_seen, of_task) = (Adds::Up(measured), Adds::Up(measured * seen_s), Adds::Up(measured * task_s));
    Some(match value.feature.name {
        "duration" if value.tool.is_none() => rests::of_all(motions, settings, in_all),
        "duration" => rests::of_tool(motions, settings, true, idle, in_all),
        "thinking_time" => rests::slow(motions, settings, measured),
        "idle_share" => rests::of_tool(motions, settings, false, idle, of_seen),
        "short_pauses" => tier(Tier::Short, Adds::Not),
        "medium_pauses" => tier(Tier::Medium, Adds::Not),
        "long_pauses" => tier(Tier::Long, Adds::Not),
        "short_pause_share" => tier(Tier::Short, of_seen),
        "medium_pause_share" => tier(Tier::Medium, of_seen),
        "long_pause_share" => tier(Tier::Long, of_seen),
        "peak_velocity" => second(Second::Fast),
        "jitter" | "relative_jitter" => second(Second::Unsteady),
        "angular_velocity" => second(Second::Turning(trocar?)),
        "path_length" => detours(Way::Length, in_all),
        "economy_of_area" | "economy_of_volume" => detours(Way::Length, Adds::Not),
        "depth_travelled" => detours(Way::Depth, in_all),
        "angular_path" => detours(Way::Turn(trocar?), in_all),
        "insertion_travelled" => detours(Way::Insertion(trocar?), in_all),
        "working_area" | "working_volume" | "spread" => second(Second::Outlying),
        "smoothness" => movements::crooked(motions, settings),
        "median_curvature" | "peak_curvature" => second(Second::Bending),
        "log_dimensionless_jerk" => worst(Measure::LogJerk),
        "normalised_jerk" => worst(Measure::Jerk),
        "spectral_arc_length" => worst(Measure::ArcLength),
        "tremor_share" => bursts::within(motions, TREMOR_HZ),
        "motion_frequency" => bursts::within(motions, (measured, f64::INFINITY)),
        "movements" => movements::many(motions, settings, measured, in_all),
        "movement_rate" => movements::many(motions, settings, measured * seen_s / 60.0, Adds::Not),
        "submovements" => movements::corrected(motions, settings, measured),
        "path_ratio" => worst(Measure::Ratio),
        "fulcrum_path_ratio" => worst(Measure::RatioAbout(trocar?)),
        "tip_distance_spread" => seconds::between(motions, Between::Unusual)?,
        "tip_distance_low" => seconds::between(motions, Between::Near)?,
        "tip_distance_high" => seconds::between(motions, Between::Far)?,
        "synchrony" | "speed_balance" | "together_share" => rests::alone(motions, settings, false, None)?,
        "one_hand_share" => rests::alone(motions, settings, false, Some(measured))?,
        "handedness" | "handedness_in_time" => rests::alone(motions, settings, true, None)?,
        "neither_share" => rests::of_both(motions, settings, measured)?,
        "not_seen_share" => absent(None, of_task)?,
        "left_view_share" => absent(Some(Cause::LeftView), of_task)?,
        "hidden_share" => absent(Some(Cause::Hidden), of_task)?,
        "lost_share" => absent(Some(Cause::Lost), of_task)?,
        "absences" | "longest_absence" => absent(None, Adds::Not)?,
        _ => return None,
    })
}

/// Features that come from the whole task alike: means and medians for which neither more nor less is a fault.
#[cfg(test)]
pub(super) const WHOLE: [&str; 3] = ["mean_velocity", "median_velocity", "tip_distance"];
