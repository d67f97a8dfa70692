//! What needs attention, and what a person dismisses of it from their own list.

use serde::Deserialize;
use utoipa::ToSchema;

use super::named;
use super::text::Invalid;
use crate::ids::{SessionId, TaskId, TraineeId};
use crate::time::from_rfc3339;

named! {
    /// Why something needs attention.
    AttentionKind: "kind" {
        /// A session may show another box.
        BoxAsked = "box_asked",
        /// The quality gate refused a session.
        Refused = "refused",
        /// A session waits for a rating.
        Unrated = "unrated",
        /// The chart shows that a trainee has lost proficiency.
        Relapsed = "relapsed",
        /// A refresher is due.
        Due = "due",
    }
}

impl AttentionKind {
    /// True if it is about sessions, false if it is an alarm of a standard's chart.
    pub fn is_of_sessions(self) -> bool {
        matches!(self, Self::BoxAsked | Self::Refused | Self::Unrated)
    }
}

/// Maximum number of days after which something dismissed is shown again.
const MAX_DAYS: u32 = 366;

/// Maximum number of sessions of one dismissal: a list of what needs attention has no more.
pub const MAX_DISMISSED_SESSIONS: usize = 20;

/// Something to be dismissed from the caller's own list, for all sessions of one trainee at one task.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewDismissal {
    /// What is dismissed.
    pub kind: AttentionKind,
    /// The trainee, as the list names them.
    pub trainee: TraineeId,
    /// The task, as the list names it.
    pub task: TaskId,
    /// The listed sessions, 1 to 20. Absent for an alarm.
    #[serde(default)]
    pub sessions: Vec<SessionId>,
    /// Of an alarm (`relapsed`, `due`): its `since`. Absent for sessions.
    #[serde(default)]
    #[schema(format = "date-time")]
    pub since: Option<String>,
    /// It is shown again after this many days, 1 to 366. Absent: not again. A session that may show another box counts
    /// nowhere until it is answered, so `box_asked` needs it.
    #[serde(default)]
    pub days: Option<u32>,
}

impl NewDismissal {
    /// Start of the dismissed alarm, epoch ms; `None` if sessions are dismissed.
    ///
    /// # Errors
    /// Sessions or a time that do not belong to the kind, too many sessions, and days outside the limits.
    pub fn since_ms(&self) -> Result<Option<i64>, Invalid> {
        match self.days {
            Some(days) if !(1..=MAX_DAYS).contains(&days) => {
                return Err(Invalid::new("days", format!("is {days}; expected 1 to {MAX_DAYS}")));
            }
            None if self.kind == AttentionKind::BoxAsked => {
                return Err(Invalid::new(
                    "days",
                    "is missing: a session that may show another box counts nowhere until it is answered, so it can \
                     only be hidden for some days",
                ));
            }
            _ => {}
        }
        if self.kind.is_of_sessions() {
            return match (self.sessions.len(), &self.since) {
                (_, Some(_)) => Err(Invalid::new("since", format!("is for alarms; `{}` has sessions", self.kind))),
                (1..=MAX_DISMISSED_SESSIONS, None) => Ok(None),
                (given, None) => {
                    let why = format!("has {given} sessions; expected 1 to {MAX_DISMISSED_SESSIONS}");
                    Err(Invalid::new("sessions", why))
                }
            };
        }
        if !self.sessions.is_empty() {
            return Err(Invalid::new("sessions", format!("is not for `{}`; send `since`", self.kind)));
        }
        let since = self.since.as_deref().and_then(from_rfc3339);
        let why = || Invalid::new("since", "expected the `since` of the alarm, a time such as 2026-05-01T08:00:00Z");
        since.map(Some).ok_or_else(why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(kind: AttentionKind, sessions: usize, since: Option<&str>, days: Option<u32>) -> NewDismissal {
        NewDismissal {
            kind,
            trainee: TraineeId::at(0),
            task: TaskId::at(0),
            sessions: (0..sessions as i64).map(SessionId::at).collect(),
            since: since.map(str::to_owned),
            days,
        }
    }

    #[test]
    fn sessions_or_the_start_of_an_alarm_are_dismissed_as_the_kind_asks_for() {
        let since = Some("2026-05-01T08:00:00Z");
        assert_eq!(new(AttentionKind::Unrated, 3, None, None).since_ms(), Ok(None));
        assert_eq!(new(AttentionKind::Due, 0, since, Some(7)).since_ms(), Ok(Some(1_777_622_400_000)));
        for (refused, field) in [
            (new(AttentionKind::Unrated, 0, None, None), "sessions"),
            (new(AttentionKind::Unrated, 21, None, None), "sessions"),
            (new(AttentionKind::Refused, 1, since, None), "since"),
            (new(AttentionKind::Due, 1, since, None), "sessions"),
            (new(AttentionKind::Relapsed, 0, None, None), "since"),
            (new(AttentionKind::Relapsed, 0, Some("soon"), None), "since"),
            (new(AttentionKind::Unrated, 1, None, Some(0)), "days"),
            (new(AttentionKind::Unrated, 1, None, Some(367)), "days"),
            (new(AttentionKind::BoxAsked, 1, None, None), "days"),
        ] {
            assert_eq!(refused.since_ms().unwrap_err().what, field, "{refused:?}");
        }
    }
}
