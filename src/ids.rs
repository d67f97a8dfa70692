//! Ids of rows: UUIDs of version 7, so that later ids sort later. Each noun has its own id type, so that ids cannot be
//! mixed up.
//!
//! Outside the process an id is always its hyphenated lower-case text.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use uuid::{NoContext, Timestamp, Uuid};

/// Text that is not an id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not an id: expected a UUID such as 0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44")]
pub struct NotAnId;

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema)]
        #[serde(transparent)]
        #[schema(value_type = String, format = "uuid")]
        pub struct $name(Uuid);

        impl $name {
            /// A new id, made at this time (epoch milliseconds).
            pub fn at(now_ms: i64) -> Self {
                Self(uuid_at(now_ms))
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.hyphenated().fmt(f)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!(stringify!($name), "({})"), self.0)
            }
        }

        impl FromStr for $name {
            type Err = NotAnId;

            fn from_str(text: &str) -> Result<Self, NotAnId> {
                parse(text).map(Self)
            }
        }
    )* };
}

ids! {
    /// A user who can sign in.
    PersonId;
    /// A training group: instructors and their trainees.
    GroupId;
    /// An access token of a program.
    TokenId;
    /// A link for choosing a password.
    PasswordLinkId;
    /// An account at a provider of single sign-on.
    IdentityId;
    /// A box trainer with its camera.
    BoxId;
    /// One version of a box's camera calibration.
    CalibrationId;
    /// One version of a box's colour samples.
    PaletteId;
    /// One self-test of a box.
    SelfTestId;
    /// A trainee.
    TraineeId;
    /// A cut of a recording into two sessions.
    CutId;
    /// A merge of two records of one person or box.
    MergeId;
    /// An exercise.
    TaskId;
    /// One version of a task's standard.
    StandardId;
    /// A reference group.
    CohortId;
    /// A course plan.
    CourseId;
    /// One version of a task's model of skill.
    ModelId;
    /// One recording of one trainee doing one task in one box.
    SessionId;
    /// A recording that waits for a name. The session that it becomes has the same id.
    WaitingRecordingId;
    /// The result of a session, computed by one version of the program.
    ResultId;
    /// One rater's rating of a session.
    RatingId;
    /// A comment on one moment of a session.
    CommentId;
    /// One version of a task's list of error items.
    ErrorListId;
    /// One version of a task's score formula.
    ScoreFormulaId;
    /// A rater's error sheet of a session.
    ErrorSheetId;
    /// An error that a rater marked on a sheet.
    ErrorMarkId;
    /// A change of a scored session.
    EditId;
    /// A move of a session to another trainee, task or box.
    MoveId;
    /// What a person dismissed from their list of what needs attention.
    DismissalId;
    /// A version of the text that trainees consent to.
    ConsentTextId;
    /// A decision of a trainee about recordings.
    ConsentId;
    /// An exam.
    ExamId;
    /// A certificate that was issued.
    CertificateId;
    /// A recording that arrives frame by frame. Its sender makes the id.
    FeedId;
    /// An order to score a task's sessions again.
    RescoringId;
    /// A resumable upload.
    UploadId;
    /// A job in the queue.
    JobId;
    /// An installation of the service: a database and its restored backups.
    InstallationId;
    /// The lease of a job. Every claim makes a new token, so a worker whose lease was lost cannot finish the job.
    LeaseToken;
}

impl From<WaitingRecordingId> for SessionId {
    fn from(WaitingRecordingId(id): WaitingRecordingId) -> Self {
        Self(id)
    }
}

impl From<SessionId> for WaitingRecordingId {
    fn from(SessionId(id): SessionId) -> Self {
        Self(id)
    }
}

fn uuid_at(now_ms: i64) -> Uuid {
    let now_ms = now_ms.max(0).unsigned_abs();
    let nanoseconds = (now_ms % 1_000) as u32 * 1_000_000;
    Uuid::new_v7(Timestamp::from_unix(NoContext, now_ms / 1_000, nanoseconds))
}

/// Accepts only the hyphenated lower-case form, so that each id has exactly one text.
fn parse(text: &str) -> Result<Uuid, NotAnId> {
    if text.len() != 36 || text.bytes().any(|b| b.is_ascii_uppercase()) {
        return Err(NotAnId);
    }
    Uuid::parse_str(text).map_err(|_| NotAnId)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_made_later_sort_later_as_values_and_as_text() {
        let (early, late) = (JobId::at(1_000), JobId::at(1_001));
        assert!(early < late);
        assert!(early.to_string() < late.to_string());
    }

    #[test]
    fn ids_of_the_same_millisecond_differ() {
        assert_ne!(JobId::at(5), JobId::at(5));
    }

    #[test]
    fn text_round_trips_and_other_spellings_are_refused() {
        let id = JobId::at(1_700_000_000_123);
        let text = id.to_string();
        assert_eq!(text.parse(), Ok(id));
        let bare = text.replace('-', "");
        for other in [text.to_uppercase().as_str(), &bare, &format!("{{{text}}}"), "", "box-1"] {
            assert_eq!(other.parse::<JobId>(), Err(NotAnId), "{other}");
        }
    }
}
