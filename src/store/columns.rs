//! How our types are stored in columns: ids, names and enumerations as text, hashes of secrets as bytes.

use sqlx::encode::IsNull;
use sqlx::error::BoxDynError;
use sqlx::query::Query;
use sqlx::sqlite::{SqliteArguments, SqliteArgumentsBuffer, SqliteTypeInfo, SqliteValueRef};
use sqlx::{Decode, Encode, Sqlite, Type};

use crate::domain::attention::AttentionKind;
use crate::domain::blob::BlobHash;
use crate::domain::calibration::CalibrationSource;
use crate::domain::centre::LogoFormat;
use crate::domain::certificate::key::CertificateKeyId;
use crate::domain::certificate::{CertificateCode, CertificateEventKind, CertificateLanguage, CertificateState};
use crate::domain::consent::{ConsentDecision, ConsentMeans};
use crate::domain::edit::EditKind;
use crate::domain::erasure::ErasedKind;
use crate::domain::exam::{AttemptCause, AttemptCompletion, AttemptOutcome, ExamResult, ExamState, IdentityCheck};
use crate::domain::feed::FrameCodec;
use crate::domain::feed::early_end::EarlyEndCause;
use crate::domain::files::annotations::View;
use crate::domain::job::{JobKind, JobState};
use crate::domain::password_state::PasswordState;
use crate::domain::rating::RatingForm;
use crate::domain::record_merge::MergedPart;
use crate::domain::rescoring::{RescoringItemState, RescoringSource};
use crate::domain::role::Role;
use crate::domain::secret::{PasswordHash, SecretHash};
use crate::domain::self_test::TrafficLight;
use crate::domain::session::{BoxQuestion, FeatureSpace, RecordedAtSource, SessionOutcome, Supervision};
use crate::domain::standard::SessionJudgement;
use crate::domain::text::{Code, FileName, Key, Login, Name, Paragraphs, Remark, TrackerName};
use crate::domain::trainee::{Handedness, Level};
use crate::domain::waiting_recording::RecordingSource;
use crate::ids::{
    BoxId, CalibrationId, CertificateId, CohortId, CommentId, ConsentId, ConsentTextId, CourseId, CutId, DismissalId,
    EditId, ErrorListId, ErrorMarkId, ErrorSheetId, ExamId, FeedId, GroupId, IdentityId, InstallationId, JobId,
    LeaseToken, MergeId, ModelId, MoveId, PaletteId, PasswordLinkId, PersonId, RatingId, RescoringId, ResultId,
    ScoreFormulaId, SelfTestId, SessionId, StandardId, TaskId, TokenId, TraineeId, UploadId, WaitingRecordingId,
};
use crate::motion::features::{self, Feature};
use crate::time::Day;

/// An `INSERT` whose values are bound. A row with many columns has a method that returns one: it binds the fields in the
/// order of the columns of a statement that stands beside it.
pub(super) type Insert = Query<'static, Sqlite, SqliteArguments>;

/// Implements storage as text with the given write and read functions.
macro_rules! as_text {
    ($($type:ty: $write:expr, $read:expr;)*) => { $(
        impl Type<Sqlite> for $type {
            fn type_info() -> SqliteTypeInfo {
                <str as Type<Sqlite>>::type_info()
            }
        }

        impl Encode<'_, Sqlite> for $type {
            fn encode_by_ref(&self, arguments: &mut SqliteArgumentsBuffer) -> Result<IsNull, BoxDynError> {
                let write: fn(&$type) -> String = $write;
                Encode::<Sqlite>::encode(write(self), arguments)
            }
        }

        impl<'r> Decode<'r, Sqlite> for $type {
            fn decode(value: SqliteValueRef<'r>) -> Result<Self, BoxDynError> {
                let read: fn(&str) -> Result<$type, BoxDynError> = $read;
                read(<&str as Decode<'r, Sqlite>>::decode(value)?)
            }
        }
    )* };
}

/// Implements storage of a text, which is not checked again when it is read.
macro_rules! as_stored {
    ($($type:ident)*) => {
        as_text! { $($type: |value| value.as_str().to_owned(), |text| Ok($type::from_stored(text.to_owned()));)* }
    };
}

/// Implements storage as text with the type's `Display` and `FromStr`.
macro_rules! as_shown {
    ($($type:ty)*) => { as_text! { $($type: |value| value.to_string(), |text| Ok(text.parse()?);)* } };
}

as_shown! {
    PersonId GroupId TokenId BoxId CalibrationId PaletteId TraineeId TaskId SessionId ResultId UploadId FeedId JobId
    InstallationId IdentityId LeaseToken PasswordLinkId SelfTestId StandardId CohortId CourseId RatingId CommentId
    RescoringId ModelId EditId MoveId BlobHash Day Role Level Handedness CalibrationSource JobKind JobState
    FeatureSpace FrameCodec TrafficLight RatingForm SessionJudgement RescoringSource RescoringItemState EditKind
    BoxQuestion RecordedAtSource EarlyEndCause ErasedKind PasswordState LogoFormat DismissalId AttentionKind
    ErrorListId ScoreFormulaId ErrorSheetId ErrorMarkId Supervision SessionOutcome ConsentId ConsentTextId ConsentDecision ConsentMeans
    WaitingRecordingId RecordingSource
    CertificateId CertificateCode CertificateKeyId CertificateLanguage CertificateState CertificateEventKind
    MergeId MergedPart CutId
    ExamId ExamState ExamResult IdentityCheck AttemptOutcome AttemptCause AttemptCompletion
}

as_stored! {
    Name Login Code FileName TrackerName Paragraphs Remark
}

as_text! {
    Key: |key| key.as_str().to_owned(), |text| Ok(Key::from(text));
    PasswordHash: |hash| hash.0.clone(), |text| Ok(PasswordHash(text.to_owned()));
    View: |view| view_name(*view).to_owned(), view_named;
}

fn view_name(view: View) -> &'static str {
    match view {
        View::Top => "top",
        View::Side => "side",
    }
}

fn view_named(name: &str) -> Result<View, BoxDynError> {
    [View::Top, View::Side].into_iter().find(|view| view_name(*view) == name).ok_or_else(|| "not a view".into())
}

/// A feature in a column of its name.
pub(super) struct FeatureColumn(pub &'static Feature);

impl Type<Sqlite> for FeatureColumn {
    fn type_info() -> SqliteTypeInfo {
        <str as Type<Sqlite>>::type_info()
    }
}

impl<'r> Decode<'r, Sqlite> for FeatureColumn {
    fn decode(value: SqliteValueRef<'r>) -> Result<Self, BoxDynError> {
        Ok(Self(features::find(<&str as Decode<'r, Sqlite>>::decode(value)?)?))
    }
}

impl Type<Sqlite> for SecretHash {
    fn type_info() -> SqliteTypeInfo {
        <[u8] as Type<Sqlite>>::type_info()
    }
}

impl Encode<'_, Sqlite> for SecretHash {
    fn encode_by_ref(&self, arguments: &mut SqliteArgumentsBuffer) -> Result<IsNull, BoxDynError> {
        Encode::<Sqlite>::encode(self.0.to_vec(), arguments)
    }
}

/// A length or count as SQLite's signed integer. Real values are far below 2⁶³; a larger one is a bug, and the schema's
/// CHECKs refuse it.
pub(super) fn integer(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(-1)
}
