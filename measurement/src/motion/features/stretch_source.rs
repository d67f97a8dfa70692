//! The kinds of stretches that explain a feature's value. [`crate::motion::stretches`] finds them.

use super::pauses::PauseTier;
use super::view::UnseenCause;

/// The stretches of the recording that explain a feature's value. A feature about the trocar has none if the trocar is
/// unknown, a feature of both hands none with one tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::motion) enum StretchSource {
    /// None: the whole task contributes alike. For means and medians for which neither more nor less is a fault.
    WholeTask,
    /// Rests of at least a pause between the own movements; for the session, rests of all tools at once. Their lengths
    /// are parts of the value, s.
    OwnRests,
    /// Time below the thinking speed. The lengths add up to the value, s.
    SlowMotion,
    /// Rests of at least a pause. The lengths add up to the value, a share of the seen time.
    Rests,
    /// Rests of a tier, which the value counts.
    CountedPauses(PauseTier),
    /// Rests of a tier. The lengths add up to the value, a share of the seen time.
    TimedPauses(PauseTier),
    /// The fastest seconds.
    FastSeconds,
    /// The seconds with the highest acceleration.
    UnsteadySeconds,
    /// The seconds with the largest angle about the trocar.
    TurningSeconds,
    /// The seconds farthest from the mean position.
    OutlyingSeconds,
    /// The seconds where the path bends most.
    BendingSeconds,
    /// Detours. Their path lengths are parts of the value, mm.
    Detours,
    /// Detours, for a value that is not a length.
    UnsummedDetours,
    /// Detours in depth. Their lengths are parts of the value, mm.
    DepthDetours,
    /// Detours about the trocar. Their angles are parts of the value, rad.
    TurningDetours,
    /// Detours along the tool. Their lengths are parts of the value, mm.
    InsertionDetours,
    /// Movements with the largest squared turns.
    CrookedMovements,
    /// Movements with the worst log dimensionless jerk.
    WorstLogJerk,
    /// Movements with the worst normalised jerk.
    WorstNormalisedJerk,
    /// Movements with the worst spectral arc length.
    WorstSpectralArcLength,
    /// Movements with the largest path ratio.
    IndirectMovements,
    /// Movements with the largest path ratio about the trocar.
    IndirectAboutTrocar,
    /// Bursts of motion in the band of tremor.
    TremorBursts,
    /// Bursts of motion above the value, Hz.
    FastBursts,
    /// Time with many movements, which the value counts.
    CountedMovements,
    /// Time with many movements, for a value per minute.
    MovementsPerMinute,
    /// Movements with many submovements.
    CorrectedMovements,
    /// The seconds when the tips' distance is unusual.
    UnusualTipDistance,
    /// The seconds when the tips are closest.
    ShortTipDistance,
    /// The seconds when the tips are farthest apart.
    LongTipDistance,
    /// Time when one hand moves alone.
    EitherHandAlone,
    /// Time when one hand moves alone. The lengths add up to the value, a share of the time both are seen.
    OneHandTime,
    /// Time when this tool's hand moves alone.
    OwnHandAlone,
    /// Rests of both hands. The lengths add up to the value, a share of the time both are seen.
    RestsOfBothHands,
    /// Absences with this cause, or with any. The lengths add up to the value, a share of the task.
    TimedAbsences(Option<UnseenCause>),
    /// Absences, for a value that is not their total.
    Absences,
}
