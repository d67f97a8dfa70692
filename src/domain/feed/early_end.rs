//! Why a live recording ended before its sender meant it to.

use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::named;

/// Longest detail, characters.
const MAX_DETAIL_CHARS: usize = 200;

named! {
    /// Why a live recording ended early.
    EarlyEndCause: "early end" {
        /// The sender lost its camera or stream, and could not open it again.
        SourceLost = "source_lost",
        /// The sender ended while it recorded or stayed away for too long, or its stream broke off.
        SenderGone = "sender_gone",
        /// A person ended it while its sender was away, or the trainee decided against recordings.
        ByPerson = "by_person",
    }
}

/// The early end of a live recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct EarlyEnd {
    /// Why it ended.
    pub cause: EarlyEndCause,
    /// What happened, in the words of the sender or the service; `null` if nothing more is known.
    pub detail: Option<String>,
}

impl EarlyEnd {
    /// An end with a cause, without a detail.
    pub fn of(cause: EarlyEndCause) -> Self {
        Self { cause, detail: None }
    }

    /// The same with a detail. It may come from a sender: what does not fit is cut off.
    pub fn with(self, detail: &str) -> Self {
        let detail: String = detail.chars().filter(|c| !c.is_control()).take(MAX_DETAIL_CHARS).collect();
        Self { detail: Some(detail).filter(|detail| !detail.trim().is_empty()), ..self }
    }
}
