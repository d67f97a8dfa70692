//! The kind of stretch that each feature has: one table that names every feature.

use super::movements::{DetourMeasure, MovementMeasure};
use super::seconds::{DistanceMeasure, SecondMeasure};
use super::{Additivity, StretchSearch, UnseenCause, absences, bursts, movements, rests, seconds};
use crate::motion::features::motion::Motion;
use crate::motion::features::pauses::PauseTier;
use crate::motion::features::spectrum::TREMOR_HZ;
use crate::motion::features::{FeatureSettings, FeatureValue};

/// How to find the stretches of a feature with this measured value on these motions, the tool's own first. `None` if
/// the feature has no stretches, because the whole task contributes alike.
pub(super) fn search_for_feature<'a>(
    value: &FeatureValue,
    measured: f64,
    motions: &[&Motion],
    settings: &'a FeatureSettings,
) -> Option<StretchSearch<'a>> {
    let own = *motions.first()?;
    let (seen_s, task_s) = (own.observed_s(), own.interval.steps() as f64 * own.step_s);
    let trocar = own.context.fulcrum;
    let idle = |steps: i64| rests::is_pause(steps, settings);
    let tier = |tier: PauseTier, adds: Additivity| {
        rests::rests_of_tool(motions, settings, false, |steps| PauseTier::of(steps, settings) == tier, adds)
    };
    let detours = |way: DetourMeasure, adds: Additivity| movements::detours(motions, settings, way, adds);
    let worst = |measure: MovementMeasure| movements::worst_movements(motions, settings, measure, measured);
    let second = |by: SecondMeasure| seconds::seconds_of_tool(motions, settings, by);
    let absent =
        |cause: Option<UnseenCause>, adds: Additivity| absences::absences_of_tool(motions, settings, cause, adds);
    let (in_all, of_seen, of_task) =
        (Additivity::Sum(measured), Additivity::Sum(measured * seen_s), Additivity::Sum(measured * task_s));
    Some(match value.feature.name {
        "duration" if value.tool.is_none() => rests::common_rests(motions, settings, in_all),
        "duration" => rests::rests_of_tool(motions, settings, true, idle, in_all),
        "thinking_time" => rests::slow_stretches(motions, settings, measured),
        "idle_share" => rests::rests_of_tool(motions, settings, false, idle, of_seen),
        "short_pauses" => tier(PauseTier::Short, Additivity::NotAdditive),
        "medium_pauses" => tier(PauseTier::Medium, Additivity::NotAdditive),
        "long_pauses" => tier(PauseTier::Long, Additivity::NotAdditive),
        "short_pause_share" => tier(PauseTier::Short, of_seen),
        "medium_pause_share" => tier(PauseTier::Medium, of_seen),
        "long_pause_share" => tier(PauseTier::Long, of_seen),
        "peak_velocity" => second(SecondMeasure::Fast),
        "jitter" | "relative_jitter" => second(SecondMeasure::Unsteady),
        "angular_velocity" => second(SecondMeasure::Turning(trocar?)),
        "path_length" => detours(DetourMeasure::Length, in_all),
        "economy_of_area" | "economy_of_volume" => detours(DetourMeasure::Length, Additivity::NotAdditive),
        "depth_travelled" => detours(DetourMeasure::Depth, in_all),
        "angular_path" => detours(DetourMeasure::Turn(trocar?), in_all),
        "insertion_travelled" => detours(DetourMeasure::Insertion(trocar?), in_all),
        "working_area" | "working_volume" | "spread" => second(SecondMeasure::Outlying),
        "smoothness" => movements::crooked_movements(motions, settings),
        "median_curvature" | "peak_curvature" => second(SecondMeasure::Bending),
        "log_dimensionless_jerk" => worst(MovementMeasure::LogJerk),
        "normalised_jerk" => worst(MovementMeasure::Jerk),
        "spectral_arc_length" => worst(MovementMeasure::ArcLength),
        "tremor_share" => bursts::bursts_in_band(motions, TREMOR_HZ),
        "motion_frequency" => bursts::bursts_in_band(motions, (measured, f64::INFINITY)),
        "movements" => movements::frequent_movements(motions, settings, measured, in_all),
        "movement_rate" => {
            movements::frequent_movements(motions, settings, measured * seen_s / 60.0, Additivity::NotAdditive)
        }
        "submovements" => movements::corrected_movements(motions, settings, measured),
        "path_ratio" => worst(MovementMeasure::Ratio),
        "fulcrum_path_ratio" => worst(MovementMeasure::RatioAboutTrocar(trocar?)),
        "tip_distance_spread" => seconds::seconds_by_distance(motions, DistanceMeasure::Unusual)?,
        "tip_distance_low" => seconds::seconds_by_distance(motions, DistanceMeasure::Near)?,
        "tip_distance_high" => seconds::seconds_by_distance(motions, DistanceMeasure::Far)?,
        "synchrony" | "speed_balance" | "together_share" => rests::one_hand_alone(motions, settings, false, None)?,
        "one_hand_share" => rests::one_hand_alone(motions, settings, false, Some(measured))?,
        "handedness" | "handedness_in_time" => rests::one_hand_alone(motions, settings, true, None)?,
        "neither_share" => rests::rests_of_both_hands(motions, settings, measured)?,
        "not_seen_share" => absent(None, of_task)?,
        "left_view_share" => absent(Some(UnseenCause::LeftView), of_task)?,
        "hidden_share" => absent(Some(UnseenCause::Hidden), of_task)?,
        "lost_share" => absent(Some(UnseenCause::Lost), of_task)?,
        "absences" | "longest_absence" => absent(None, Additivity::NotAdditive)?,
        _ => return None,
    })
}

/// Features that come from the whole task alike: means and medians for which neither more nor less is a fault.
#[cfg(test)]
pub(super) const WHOLE_TASK_FEATURES: [&str; 3] = ["mean_velocity", "median_velocity", "tip_distance"];
