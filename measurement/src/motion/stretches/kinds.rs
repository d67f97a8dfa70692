//! How each [`StretchSource`] finds the stretches that explain a feature.

use super::movements::{DetourMeasure, MovementMeasure};
use super::seconds::{DistanceMeasure, SecondMeasure};
use super::{Additivity, StretchSearch, UnseenCause, absences, bursts, movements, rests, seconds};
use crate::motion::features::motion::Motion;
use crate::motion::features::pauses::PauseTier;
use crate::motion::features::spectrum::TREMOR_HZ;
use crate::motion::features::{FeatureSettings, FeatureValue, StretchSource};

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
    Some(match value.feature.stretches {
        StretchSource::WholeTask => return None,
        StretchSource::OwnRests if value.tool.is_none() => rests::common_rests(motions, settings, in_all),
        StretchSource::OwnRests => rests::rests_of_tool(motions, settings, true, idle, in_all),
        StretchSource::SlowMotion => rests::slow_stretches(motions, settings, measured),
        StretchSource::Rests => rests::rests_of_tool(motions, settings, false, idle, of_seen),
        StretchSource::CountedPauses(length) => tier(length, Additivity::NotAdditive),
        StretchSource::TimedPauses(length) => tier(length, of_seen),
        StretchSource::FastSeconds => second(SecondMeasure::Fast),
        StretchSource::UnsteadySeconds => second(SecondMeasure::Unsteady),
        StretchSource::TurningSeconds => second(SecondMeasure::Turning(trocar?)),
        StretchSource::OutlyingSeconds => second(SecondMeasure::Outlying),
        StretchSource::BendingSeconds => second(SecondMeasure::Bending),
        StretchSource::Detours => detours(DetourMeasure::Length, in_all),
        StretchSource::UnsummedDetours => detours(DetourMeasure::Length, Additivity::NotAdditive),
        StretchSource::DepthDetours => detours(DetourMeasure::Depth, in_all),
        StretchSource::TurningDetours => detours(DetourMeasure::Turn(trocar?), in_all),
        StretchSource::InsertionDetours => detours(DetourMeasure::Insertion(trocar?), in_all),
        StretchSource::CrookedMovements => movements::crooked_movements(motions, settings),
        StretchSource::WorstLogJerk => worst(MovementMeasure::LogJerk),
        StretchSource::WorstNormalisedJerk => worst(MovementMeasure::Jerk),
        StretchSource::WorstSpectralArcLength => worst(MovementMeasure::ArcLength),
        StretchSource::IndirectMovements => worst(MovementMeasure::Ratio),
        StretchSource::IndirectAboutTrocar => worst(MovementMeasure::RatioAboutTrocar(trocar?)),
        StretchSource::TremorBursts => bursts::bursts_in_band(motions, TREMOR_HZ),
        StretchSource::FastBursts => bursts::bursts_in_band(motions, (measured, f64::INFINITY)),
        StretchSource::CountedMovements => movements::frequent_movements(motions, settings, measured, in_all),
        StretchSource::MovementsPerMinute => {
            movements::frequent_movements(motions, settings, measured * seen_s / 60.0, Additivity::NotAdditive)
        }
        StretchSource::CorrectedMovements => movements::corrected_movements(motions, settings, measured),
        StretchSource::UnusualTipDistance => seconds::seconds_by_distance(motions, DistanceMeasure::Unusual)?,
        StretchSource::ShortTipDistance => seconds::seconds_by_distance(motions, DistanceMeasure::Near)?,
        StretchSource::LongTipDistance => seconds::seconds_by_distance(motions, DistanceMeasure::Far)?,
        StretchSource::EitherHandAlone => rests::one_hand_alone(motions, settings, false, None)?,
        StretchSource::OneHandTime => rests::one_hand_alone(motions, settings, false, Some(measured))?,
        StretchSource::OwnHandAlone => rests::one_hand_alone(motions, settings, true, None)?,
        StretchSource::RestsOfBothHands => rests::rests_of_both_hands(motions, settings, measured)?,
        StretchSource::TimedAbsences(cause) => absent(cause, of_task)?,
        StretchSource::Absences => absent(None, Additivity::NotAdditive)?,
    })
}
