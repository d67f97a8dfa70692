//! Consent of trainees to recordings: texts, decisions, and the one rule that says whether new recordings may arrive.

use serde::Deserialize;
use utoipa::ToSchema;

use super::named;
use super::text::{Invalid, Name, Paragraphs};
use crate::ids::ConsentTextId;
use crate::time::Day;

named! {
    /// A decision about recordings of a trainee.
    ConsentDecision: "consent decision" {
        /// The trainee consents.
        Given = "given",
        /// The trainee does not consent, and had not before.
        Refused = "refused",
        /// The trainee takes the consent back.
        Withdrawn = "withdrawn",
    }
}

named! {
    /// How a decision was recorded.
    ConsentMeans: "means of a consent" {
        /// The trainee decided after signing in.
        SignedIn = "signed_in",
        /// Staff recorded it from a signed paper.
        Paper = "paper",
        /// Staff recorded it without a paper, at the wish of the trainee.
        Staff = "staff",
    }
}

named! {
    /// Whether a trainee consents to recordings.
    ConsentState: "consent state" {
        /// The centre requires no consent, and the trainee has not decided.
        NotNeeded = "not_needed",
        /// The trainee consents to the version that is required, or to a later one.
        Given = "given",
        /// A version that the trainee has not consented to will be required.
        Due = "due",
        /// The trainee has not consented to the version that is required.
        Missing = "missing",
        /// The trainee does not consent.
        Refused = "refused",
        /// The trainee has withdrawn the consent.
        Withdrawn = "withdrawn",
    }
}

/// The versions of the text that new recordings need consent to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RequiredVersions {
    /// The version that is required now; `None`: consent is not required.
    pub now: Option<i64>,
    /// The latest version that will be required later.
    pub later: Option<i64>,
}

impl ConsentState {
    /// The state that follows from the latest decision of a trainee, with the version that it is about. A refusal and a
    /// withdrawal count at once, also where consent is not required.
    pub fn of(latest: Option<(ConsentDecision, i64)>, required: RequiredVersions) -> Self {
        let given = match latest {
            Some((ConsentDecision::Refused, _)) => return Self::Refused,
            Some((ConsentDecision::Withdrawn, _)) => return Self::Withdrawn,
            Some((ConsentDecision::Given, version)) => Some(version),
            None => None,
        };
        let covers = |needed: Option<i64>| needed.is_none_or(|needed| given.is_some_and(|given| given >= needed));
        match (covers(required.now), covers(required.later)) {
            (false, _) => Self::Missing,
            (true, false) => Self::Due,
            (true, true) if given.is_some() => Self::Given,
            (true, true) => Self::NotNeeded,
        }
    }

    /// True if new recordings of the trainee may arrive.
    pub fn allows_recordings(self) -> bool {
        matches!(self, Self::NotNeeded | Self::Given | Self::Due)
    }

    /// True if a recording of the trainee that has begun must end: the trainee said so. One that began before a version
    /// was required continues.
    pub fn ends_running_recordings(self) -> bool {
        matches!(self, Self::Refused | Self::Withdrawn)
    }

    /// Why new recordings are refused, and what to do: short enough for the reason of a closed connection.
    pub fn why_refused(self) -> &'static str {
        match self {
            Self::Withdrawn => {
                "this trainee has withdrawn the consent to recordings: record nothing, or ask for a new one"
            }
            Self::Refused => {
                "this trainee does not consent to recordings: record nothing, or ask for the consent again"
            }
            Self::NotNeeded | Self::Given | Self::Due | Self::Missing => {
                "this trainee has not consented to recordings yet: the page Account asks, or staff record a paper"
            }
        }
    }
}

/// A consent text in one language.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, serde::Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ConsentWording {
    /// Title, 1 to 120 characters.
    pub title: Name,
    /// Text in paragraphs, 1 to 10,000 characters: plain text, never markup.
    pub body: Paragraphs,
}

/// A consent text to publish: in English, in German, or in both.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewConsentText {
    /// The English text.
    #[serde(default)]
    pub en: Option<ConsentWording>,
    /// The German text.
    #[serde(default)]
    pub de: Option<ConsentWording>,
    /// First day on which new recordings need consent to this version. Absent or `null`: this version is offered, and an
    /// earlier consent suffices where one is required.
    #[serde(default)]
    pub required_from: Option<Day>,
}

impl NewConsentText {
    /// Checks that there is a text.
    ///
    /// # Errors
    /// Both languages are missing, or a text is empty.
    pub fn check(&self) -> Result<(), Invalid> {
        if self.en.is_none() && self.de.is_none() {
            return Err(Invalid::new("en", "is missing: give the text in English, or in German as `de`"));
        }
        for (field, wording) in [("en.body", &self.en), ("de.body", &self.de)] {
            if wording.as_ref().is_some_and(|wording| wording.body.as_str().trim().is_empty()) {
                return Err(Invalid::new(field, "is empty: write what the trainee consents to"));
            }
        }
        Ok(())
    }
}

/// When a published text is required.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ConsentTextChange {
    /// First day on which new recordings need consent to this version; `null`: they do not.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(required = true)]
    pub required_from: Option<Day>,
}

/// A decision to record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewConsent {
    /// What the trainee decided.
    pub decision: ConsentDecision,
    /// The text that was shown or signed; needed for `given` and `refused`. A withdrawal is about the text of the consent.
    #[serde(default)]
    pub text: Option<ConsentTextId>,
    /// The day on the paper. Staff who record a consent must give it; a trainee has none.
    #[serde(default)]
    pub signed_on: Option<Day>,
}

impl NewConsent {
    /// How the decision is recorded.
    ///
    /// # Errors
    /// A consent that staff record has no paper, a trainee names one, or its day is after `today`.
    pub fn means(&self, is_own: bool, today: Day) -> Result<ConsentMeans, Invalid> {
        match (self.signed_on, is_own) {
            (Some(_), true) => {
                Err(Invalid::new("signed_on", "is for consents on paper, which instructors and administrators record"))
            }
            (None, true) => Ok(ConsentMeans::SignedIn),
            (Some(day), false) if day > today.plus_days(1) => {
                Err(Invalid::new("signed_on", "is in the future: give the day on the paper"))
            }
            (Some(_), false) => Ok(ConsentMeans::Paper),
            (None, false) if self.decision == ConsentDecision::Given => Err(Invalid::new(
                "signed_on",
                "is missing: give the day on the signed paper. Without a paper, the trainee consents on the page Account",
            )),
            (None, false) => Ok(ConsentMeans::Staff),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn state(latest: Option<(ConsentDecision, i64)>, now: Option<i64>, later: Option<i64>) -> ConsentState {
        ConsentState::of(latest, RequiredVersions { now, later })
    }

    #[test]
    fn a_version_counts_from_its_day_on_and_a_later_one_covers_it() {
        let given = |version| Some((ConsentDecision::Given, version));
        assert_eq!(state(None, None, None), ConsentState::NotNeeded);
        assert_eq!(state(None, None, Some(1)), ConsentState::Due);
        assert_eq!(state(None, Some(1), None), ConsentState::Missing);
        assert_eq!(state(given(1), Some(1), None), ConsentState::Given);
        assert_eq!(state(given(1), Some(1), Some(2)), ConsentState::Due);
        assert_eq!(state(given(1), Some(2), None), ConsentState::Missing);
        assert_eq!(state(given(3), Some(1), Some(2)), ConsentState::Given);
        assert_eq!(state(given(1), None, None), ConsentState::Given);
    }

    proptest! {
        #[test]
        fn a_no_stops_recordings_with_and_without_a_required_version(
            now in proptest::option::of(1..9_i64), later in proptest::option::of(1..9_i64), version in 1..9_i64,
        ) {
            for decision in [ConsentDecision::Refused, ConsentDecision::Withdrawn] {
                let state = state(Some((decision, version)), now, later);
                prop_assert!(!state.allows_recordings() && state.ends_running_recordings());
            }
        }

        #[test]
        fn what_is_required_later_stops_nothing_now(
            now in proptest::option::of(1..9_i64), later in 1..9_i64, given in proptest::option::of(1..9_i64),
        ) {
            let latest = given.map(|version| (ConsentDecision::Given, version));
            let before = state(latest, now, None).allows_recordings();
            prop_assert_eq!(state(latest, now, Some(later)).allows_recordings(), before);
        }
    }

    #[test]
    fn each_reason_fits_into_a_close_frame() {
        for state in ConsentState::ALL {
            assert!(state.why_refused().len() <= 123, "{state}");
        }
    }
}
