//! Merging two records of one person, or of one box, and separating them again.

use serde::Deserialize;
use utoipa::ToSchema;

use super::named;
use super::text::{Key, Remark};

named! {
    /// What follows the kept record, or stays with the merged one.
    MergedPart: "part" {
        /// Sessions.
        Sessions = "sessions",
        /// Uploads, for as long as the service remembers them.
        Uploads = "uploads",
        /// Memberships in groups; of a box, the groups that may change it.
        Groups = "groups",
        /// Places on lists of reference groups.
        Cohorts = "cohorts",
        /// Decisions about recordings.
        Consents = "consents",
        /// For how long videos are kept.
        Retention = "retention",
        /// Entries about who looked at whole exports, or at sessions that were deleted.
        AccessEntries = "access_entries",
        /// What staff dismissed from their lists.
        Dismissals = "dismissals",
        /// Certificates.
        Certificates = "certificates",
        /// Exams.
        Exams = "exams",
        /// Recordings that wait for a name, and that a list gives to the person, or that are of the box.
        WaitingRecordings = "waiting_recordings",
        /// The account.
        Account = "account",
        /// Comments of the account.
        Comments = "comments",
        /// Accounts at the provider of single sign-on.
        Identities = "identities",
        /// Tokens of programs.
        Tokens = "tokens",
        /// When sessions were opened.
        Openings = "openings",
        /// Versions of the camera.
        Calibrations = "calibrations",
        /// Versions of the colours.
        Palettes = "palettes",
        /// Self-tests.
        SelfTests = "self_tests",
        /// Jobs on the box, such as calibrations.
        Jobs = "jobs",
        /// Live recordings.
        Feeds = "feeds",
        /// Answers to the question for the box.
        Answers = "answers",
    }
}

/// The other record of the same person.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TraineeMergePreview {
    /// The record that is merged into this one, by id or code.
    #[schema(value_type = String)]
    pub trainee: Key,
}

/// Merges another record of the same person into this one.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTraineeMerge {
    /// The record that is merged into this one, by id or code.
    #[schema(value_type = String)]
    pub trainee: Key,
    /// The reason, for later readers: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
    /// The number of videos that the merge deletes at once, as the preview gave it; not needed if there are none.
    #[serde(default)]
    pub confirmed_videos: u64,
}

/// The other record of the same box.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxMergePreview {
    /// The record that is merged into this one, by id or code.
    #[serde(rename = "box")]
    #[schema(value_type = String)]
    pub other_box: Key,
}

/// Merges another record of the same box into this one.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewBoxMerge {
    /// The record that is merged into this one, by id or code.
    #[serde(rename = "box")]
    #[schema(value_type = String)]
    pub other_box: Key,
    /// The reason, for later readers: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
}

/// Separates two merged records.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordSeparation {
    /// The reason, for later readers: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
}
