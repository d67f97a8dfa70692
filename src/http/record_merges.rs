//! What merges of two records of one person or of one box look like. The routes are those of trainees and of boxes.

use serde::Serialize;
use utoipa::ToSchema;

use super::show::{NamedReference, Time};
use crate::domain::consent::ConsentState;
use crate::domain::record_merge::MergedPart;
use crate::ids::MergeId;
use crate::store::{MergeEffect, MergedCount, PartCount, RecordMerge};

/// A merge of two records.
#[derive(Debug, Serialize, ToSchema)]
pub struct MergeResponse {
    id: MergeId,
    /// The record that is hidden. Its id and code lead to the kept record.
    merged: NamedReference,
    /// What followed the kept record; empty after the separation.
    follow: Vec<FollowedPart>,
    /// The reason: plain text, never markup.
    why: String,
    /// Name of the person; `null` if the person was deleted, or if the service merged them.
    who: Option<String>,
    created_at: Time,
    /// Why the records were separated; `null`: they are merged.
    separated_why: Option<String>,
    /// Name of the person who separated them; `null` likewise, and if the person was deleted.
    separated_who: Option<String>,
    /// When they were separated; `null`: they are merged.
    separated_at: Option<Time>,
}

/// Number of things of one kind that followed the kept record.
#[derive(Debug, Serialize, ToSchema)]
pub struct FollowedPart {
    part: MergedPart,
    rows: i64,
}

impl From<RecordMerge> for MergeResponse {
    fn from(made: RecordMerge) -> Self {
        let follow = made.follow.into_iter().map(|PartCount { part, rows }| FollowedPart { part, rows });
        Self {
            id: made.id,
            merged: made.merged.into(),
            follow: follow.collect(),
            why: made.why.into(),
            who: made.who.map(String::from),
            created_at: Time(made.created_at_ms),
            separated_why: made.separated_why.map(String::from),
            separated_who: made.separated_who.map(String::from),
            separated_at: made.separated_at_ms.map(Time),
        }
    }
}

/// What a merge would do.
#[derive(Debug, Serialize, ToSchema)]
pub struct MergePreviewResponse {
    /// The record that would be hidden.
    merged: NamedReference,
    /// What belongs to it. Kinds without any are left out.
    parts: Vec<MergedPartCount>,
    /// The kept record lacks a level, and takes over that of the other one.
    takes_level: bool,
    /// The kept record lacks a preferred hand, and takes over that of the other one.
    takes_handedness: bool,
    /// Videos that the merge deletes at once, because the shorter of two times for keeping videos counts. Confirm this
    /// number in `confirmed_videos`.
    due_videos: u64,
    /// Whether the person consents to recordings afterwards: the latest decision of both records counts. `null` for boxes.
    consent: Option<ConsentState>,
    /// Login of the account that cannot sign in any more, because both records have one; its accounts at the provider of
    /// single sign-on and its tokens open the other account. `null`: none.
    closed_login: Option<String>,
}

/// What happens to things of one kind.
#[derive(Debug, Serialize, ToSchema)]
pub struct MergedPartCount {
    part: MergedPart,
    /// How many follow the kept record.
    follow: i64,
    /// How many stay with the hidden record and count nowhere, because the kept one has the same.
    stay: i64,
}

impl MergePreviewResponse {
    /// What merging this record would do.
    pub fn new(merged: NamedReference, effect: MergeEffect) -> Self {
        let MergeEffect { counts, takes_level, takes_handedness, due_videos, consent, closed_login, .. } = effect;
        let count = |MergedCount { part, follow, stay }| MergedPartCount { part, follow, stay };
        let parts = counts.into_iter().map(count).collect();
        Self { merged, parts, takes_level, takes_handedness, due_videos, consent, closed_login }
    }
}
