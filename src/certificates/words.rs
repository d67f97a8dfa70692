//! The words of a certificate, in its language. The pages have the same German titles of features in
//! `static/texts/de.js`; a test compares them.

use crate::domain::certificate::{
    CertificateBasis, CertificateContent, CertificateLanguage, CertifiedExam, CertifiedSession,
};
use crate::domain::exam::IdentityCheck;
use crate::domain::feature::FeatureKey;
use crate::domain::hand::Hand;
use crate::domain::session::{FeatureSpace, Supervision};
use crate::domain::standard::{Better, StandardRule, Target};
use crate::time::Day;

use CertificateLanguage::{De, En};

/// German titles of features. English ones are in the features themselves.
const GERMAN_TITLES: &[(&str, &str)] = &[
    ("duration", "Dauer"),
    ("thinking_time", "Bedenkzeit"),
    ("idle_share", "Anteil der Ruhezeit"),
    ("short_pauses", "Pausen unter 1 s"),
    ("medium_pauses", "Pausen von 1 bis 3 s"),
    ("long_pauses", "Pausen ab 3 s"),
    ("short_pause_share", "Anteil der Pausen unter 1 s"),
    ("medium_pause_share", "Anteil der Pausen von 1 bis 3 s"),
    ("long_pause_share", "Anteil der Pausen ab 3 s"),
    ("mean_velocity", "Mittlere Geschwindigkeit"),
    ("median_velocity", "Median der Geschwindigkeit"),
    ("peak_velocity", "Spitzengeschwindigkeit (95\u{a0}%)"),
    ("jitter", "Unstetigkeit"),
    ("relative_jitter", "Relative Unstetigkeit"),
    ("path_length", "Weglänge"),
    ("depth_travelled", "Weg in der Tiefe"),
    ("economy_of_area", "Flächenökonomie"),
    ("economy_of_volume", "Raumökonomie"),
    ("working_area", "Arbeitsfläche"),
    ("working_volume", "Arbeitsraum"),
    ("spread", "Streuung"),
    ("path_ratio", "Wegverhältnis"),
    ("fulcrum_path_ratio", "Wegverhältnis um den Trokar"),
    ("angular_path", "Winkelweg"),
    ("angular_velocity", "Mittlere Winkelgeschwindigkeit"),
    ("insertion_travelled", "Weg entlang des Trokars"),
    ("smoothness", "Flüssigkeit"),
    ("tremor_share", "Anteil von 3 bis 6 Hz"),
    ("motion_frequency", "Bewegungsfrequenz (95\u{a0}%)"),
    ("median_curvature", "Median der Krümmung"),
    ("peak_curvature", "Spitzenkrümmung (95\u{a0}%)"),
    ("movements", "Zahl der Bewegungen"),
    ("movement_rate", "Bewegungen pro Minute"),
    ("submovements", "Zahl der Teilbewegungen"),
    ("log_dimensionless_jerk", "Log. dimensionsloser Ruck"),
    ("normalised_jerk", "Normierter Ruck"),
    ("spectral_arc_length", "Spektrale Bogenlänge"),
    ("synchrony", "Gleichlauf der Hände"),
    ("together_share", "Anteil gemeinsamer Bewegung"),
    ("one_hand_share", "Anteil mit nur einer Hand"),
    ("neither_share", "Anteil beider in Ruhe"),
    ("speed_balance", "Ausgleich der Geschwindigkeiten"),
    ("handedness", "Anteil an der Arbeit"),
    ("handedness_in_time", "Anteil an der Bewegungszeit"),
    ("tip_distance", "Abstand der Spitzen"),
    ("tip_distance_spread", "Streuung des Abstands der Spitzen"),
    ("tip_distance_low", "Abstand der Spitzen (5\u{a0}%)"),
    ("tip_distance_high", "Abstand der Spitzen (95\u{a0}%)"),
    ("not_seen_share", "Anteil nicht gesehen"),
    ("left_view_share", "Anteil aus dem Bild"),
    ("hidden_share", "Anteil hinter dem anderen Instrument"),
    ("lost_share", "Anteil vom Programm verloren"),
    ("absences", "Wie oft nicht gesehen"),
    ("longest_absence", "Längste Zeit nicht gesehen"),
];

/// The fixed words of a sheet.
pub(super) struct SheetWords {
    pub title: &'static str,
    pub certifies: &'static str,
    pub limits: &'static str,
    pub sessions: &'static str,
    pub claimed: &'static str,
    pub check: &'static str,
}

const ENGLISH: SheetWords = SheetWords {
    title: "Certificate",
    certifies: "This certifies that",
    limits: "Each of the sessions below met all of these limits, error bars included:",
    sessions: "Sessions that this certificate is based on:",
    claimed: "* The sender of the recording stated this day; the service cannot vouch for it.",
    check: "Is it genuine, and still valid?",
};

const GERMAN: SheetWords = SheetWords {
    title: "Zertifikat",
    certifies: "Hiermit wird bescheinigt:",
    limits: "Jede der Sitzungen unten hielt alle diese Grenzwerte ein, Fehlerbalken eingeschlossen:",
    sessions: "Sitzungen, auf denen dieses Zertifikat beruht:",
    claimed: "* Diesen Tag hat der Absender der Aufnahme angegeben; der Dienst kann ihn nicht bestätigen.",
    check: "Ist es echt, und gilt es noch?",
};

/// The fixed words in this language.
pub(super) fn of(language: CertificateLanguage) -> &'static SheetWords {
    match language {
        En => &ENGLISH,
        De => &GERMAN,
    }
}

const ENGLISH_MONTHS: [&str; 12] = [
    "January",
    "February",
    "March",
    "April",
    "May",
    "June",
    "July",
    "August",
    "September",
    "October",
    "November",
    "December",
];
const GERMAN_MONTHS: [&str; 12] = [
    "Januar",
    "Februar",
    "März",
    "April",
    "Mai",
    "Juni",
    "Juli",
    "August",
    "September",
    "Oktober",
    "November",
    "Dezember",
];

/// A day such as `2026-11-30` in words, which no line breaks: `30 November 2026`.
pub(super) fn day(language: CertificateLanguage, iso: &str) -> String {
    let parts: Vec<usize> = iso.split('-').filter_map(|part| part.parse().ok()).collect();
    match (parts.as_slice(), language) {
        ([year, month @ 1..=12, day], En) => format!("{day}\u{a0}{}\u{a0}{year}", ENGLISH_MONTHS[month - 1]),
        ([year, month @ 1..=12, day], De) => format!("{day}.\u{a0}{}\u{a0}{year}", GERMAN_MONTHS[month - 1]),
        _ => iso.to_owned(),
    }
}

/// `has met the standard of the task “Peg transfer”`, or has passed the exam in it.
pub(super) fn has_met(content: &CertificateContent) -> String {
    let task = &content.task;
    match content.language {
        En if content.exam.is_some() => format!("has passed the exam in the task “{task}”"),
        De if content.exam.is_some() => format!("hat die Prüfung in der Aufgabe „{task}“ bestanden"),
        En => format!("has met the standard of the task “{task}”"),
        De => format!("hat den Standard der Aufgabe „{task}“ erfüllt"),
    }
}

/// How and when the standard was met.
pub(super) fn how(content: &CertificateContent) -> String {
    if let Some(exam) = &content.exam {
        return how_examined(content, exam);
    }
    let (language, standard) = (content.language, &content.standard);
    let (on, set) = (day(language, &content.earned_on), day(language, &standard.set_on));
    let version = standard.version;
    let how = match (language, content.basis, &standard.rule) {
        (En, CertificateBasis::Rule, Some(rule)) => format!("By the pass rule: {rule}."),
        (De, CertificateBasis::Rule, Some(rule)) => format!("Nach der Bestehensregel: {rule}."),
        (En, CertificateBasis::Charts, _) => {
            "By the chart of the sessions (LC-CUSUM), which shows proficiency.".to_owned()
        }
        (De, CertificateBasis::Charts, _) => {
            "Nach dem Diagramm der Sitzungen (LC-CUSUM), das Beherrschung anzeigt.".to_owned()
        }
        _ => String::new(),
    };
    let when = match language {
        En => format!("Met on {on}. Standard: version {version} of {set}."),
        De => format!("Erfüllt am {on}. Standard: Version {version} vom {set}."),
    };
    format!("{how} {when}").trim().to_owned()
}

/// When and how the person was examined, and the standard.
fn how_examined(content: &CertificateContent, exam: &CertifiedExam) -> String {
    let (language, standard) = (content.language, &content.standard);
    let (on, set, version) = (day(language, &exam.held_on), day(language, &standard.set_on), standard.version);
    let CertifiedExam { examiner, attempts_used: used, attempts_allowed: allowed, .. } = exam;
    let identity = identity(language, exam.identity);
    let voided = voided(language, &exam.voided);
    match language {
        En => format!(
            "Exam on {on}. Examiner: {examiner}. Identity confirmed by {identity}. Attempts used: {used} of {allowed}{voided}. \
             Standard: version {version} of {set}, fixed before the exam."
        ),
        De => format!(
            "Prüfung am {on}. Prüfer/in: {examiner}. Identität bestätigt durch {identity}. Genutzte Versuche: {used} von \
             {allowed}{voided}. Standard: Version {version} vom {set}, vor der Prüfung festgelegt."
        ),
    }
}

/// The attempts that were declared void: continues `Attempts used: 1 of 1`.
fn voided(language: CertificateLanguage, numbers: &[u32]) -> String {
    let list = |and: &str| {
        let numbers: Vec<String> = numbers.iter().map(u32::to_string).collect();
        match numbers.as_slice() {
            [first @ .., last] if !first.is_empty() => format!("{} {and} {last}", first.join(", ")),
            one => one.concat(),
        }
    };
    match (language, numbers.len()) {
        (_, 0) => String::new(),
        (En, 1) => format!(" (attempt {} was declared void after a technical failure)", list("and")),
        (En, _) => format!(" (attempts {} were declared void after technical failures)", list("and")),
        (De, 1) => format!(" (Versuch {} wurde nach einem technischen Fehler gestrichen)", list("und")),
        (De, _) => format!(" (die Versuche {} wurden nach technischen Fehlern gestrichen)", list("und")),
    }
}

/// How the examiner confirmed who the candidate is: continues `confirmed by`.
fn identity(language: CertificateLanguage, check: IdentityCheck) -> &'static str {
    match (language, check) {
        (En, IdentityCheck::Badge) => "badge with a photo",
        (En, IdentityCheck::Document) => "identity document",
        (En, IdentityCheck::Known) => "the examiner, who knows the person",
        (De, IdentityCheck::Badge) => "Ausweis der Einrichtung mit Foto",
        (De, IdentityCheck::Document) => "amtlichen Ausweis",
        (De, IdentityCheck::Known) => "persönliche Bekanntschaft",
    }
}

/// The line above the sessions: they are attempts of an exam, or what counted.
pub(super) fn sessions(content: &CertificateContent) -> &'static str {
    match (content.language, content.exam.is_some()) {
        (En, true) => "The attempt of the exam that met the standard:",
        (De, true) => "Der Versuch der Prüfung, der den Standard erfüllte:",
        (language, false) => of(language).sessions,
    }
}

/// The line above the limits.
pub(super) fn limits(content: &CertificateContent) -> &'static str {
    match (content.language, content.exam.is_some()) {
        (En, true) => "The attempt below met all of these limits, error bars included:",
        (De, true) => "Der Versuch unten hielt alle diese Grenzwerte ein, Fehlerbalken eingeschlossen:",
        (language, false) => of(language).limits,
    }
}

/// A session in one short line; `*` marks a day that the sender stated. `is_long`: the list is, so days are in short.
pub(super) fn session(content: &CertificateContent, session: &CertifiedSession, is_long: bool) -> String {
    let language = content.language;
    let CertifiedSession { number, recorded_on, day_known, supervision } = session;
    let star = if *day_known { "" } else { "*" };
    let is_supervised = match (supervision, language) {
        (None, En) => "supervision not noted",
        (None, De) => "Aufsicht nicht vermerkt",
        (Some(Supervision::None), En) => "not supervised",
        (Some(Supervision::None), De) => "nicht beaufsichtigt",
        (Some(_), En) => "supervised",
        (Some(_), De) => "beaufsichtigt",
    };
    let number_sign = match (language, content.exam.is_some()) {
        (En, true) => "Attempt",
        (De, true) => "Versuch",
        (En, false) => "No.",
        (De, false) => "Nr.",
    };
    let on = if is_long { recorded_on.clone() } else { day(language, recorded_on) };
    format!("{number_sign} {number}: {on}{star}, {is_supervised}")
}

/// Who issued it, and the program's version.
pub(super) fn issued(content: &CertificateContent) -> String {
    let on = day(content.language, &content.issued_on);
    let CertificateContent { issuer, program, measurement, .. } = content;
    match content.language {
        En => format!("Issued on {on} by {issuer}. Trocar {program}, version of the measurement: {measurement}."),
        De => format!("Ausgestellt am {on} von {issuer}. Trocar {program}, Version der Messung: {measurement}."),
    }
}

/// How to check it.
pub(super) fn how_to_check(content: &CertificateContent) -> String {
    let key = &content.key;
    match content.language {
        En => format!(
            "Scan the code or open the address: the page shows what this certificate says, and whether it was withdrawn. \
             This file is signed with the key {key}; the page also checks a file."
        ),
        De => format!(
            "Scannen Sie den Code oder öffnen Sie die Adresse: Die Seite zeigt, was dieses Zertifikat sagt, und ob es \
             zurückgezogen wurde. Diese Datei ist mit dem Schlüssel {key} signiert; die Seite prüft auch eine Datei."
        ),
    }
}

/// A limit of a standard in words: `Path length, left hand: at most 300 mm`.
pub fn limit(language: CertificateLanguage, target: &Target) -> String {
    let of = feature(language, &target.of, &target.title);
    let unit = if target.unit == "1" { "" } else { target.unit.as_str() };
    let amount = format!("{} {unit}", number(language, target.limit));
    let side = match (language, target.better) {
        (En, Better::Lower) => "at most",
        (En, Better::Higher) => "at least",
        (De, Better::Lower) => "höchstens",
        (De, Better::Higher) => "mindestens",
    };
    format!("{of}: {side} {}", amount.trim_end())
}

/// The feature with its hand or tool.
fn feature(language: CertificateLanguage, of: &FeatureKey, english: &str) -> String {
    let german = || GERMAN_TITLES.iter().find(|(name, _)| *name == of.feature.name).map(|(_, title)| *title);
    let title = match language {
        En => english,
        De => german().unwrap_or(english),
    };
    let hand = of.in_hand.map(|hand| match (language, hand) {
        (En, Hand::Left) => "left hand",
        (En, Hand::Right) => "right hand",
        (En, Hand::Dominant) => "dominant hand",
        (En, Hand::Other) => "other hand",
        (De, Hand::Left) => "linke Hand",
        (De, Hand::Right) => "rechte Hand",
        (De, Hand::Dominant) => "dominante Hand",
        (De, Hand::Other) => "andere Hand",
    });
    let held = match (hand, &of.tool) {
        (Some(hand), Some(tool)) => Some(format!("{hand} ({tool})")),
        (Some(hand), None) => Some(hand.to_owned()),
        (None, tool) => tool.clone(),
    };
    let in_image = (of.space == FeatureSpace::Image).then(|| match language {
        En => "in the image".to_owned(),
        De => "im Bild".to_owned(),
    });
    [Some(title.to_owned()), held, in_image].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// A limit's number with all of its digits, as people write it in this language.
fn number(language: CertificateLanguage, value: f64) -> String {
    let text = format!("{value}").replace('-', "\u{2212}");
    match language {
        En => text,
        De => text.replace('.', ","),
    }
}

/// A pass rule in words.
pub fn rule(language: CertificateLanguage, rule: &StandardRule) -> String {
    let StandardRule { in_a_row, then_more, at_most } = *rule;
    let many = |count: usize, one: &str, more: &str| format!("{count} {}", if count == 1 { one } else { more });
    let (first, more, within) = match language {
        En => (
            format!("{} in a row", many(in_a_row, "pass", "passes")),
            format!(", then {then_more} more"),
            at_most.map(|most| format!(", within {}", many(most, "session", "sessions"))),
        ),
        De => (
            format!("{in_a_row}-mal in Folge bestanden"),
            format!(", danach {then_more} weitere Male"),
            at_most.map(|most| format!(", innerhalb von {}", many(most, "Sitzung", "Sitzungen"))),
        ),
    };
    let more = if then_more > 0 { more } else { String::new() };
    format!("{first}{more}{}", within.unwrap_or_default())
}

/// The day of a time, epoch ms.
pub fn day_of(time_ms: i64) -> String {
    Day::of(time_ms).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::features::FEATURES;

    #[test]
    fn german_titles_are_those_of_the_pages() {
        let pages = include_str!("../../static/texts/de.js");
        for feature in FEATURES {
            let own = GERMAN_TITLES.iter().find(|(name, _)| *name == feature.name);
            let (name, title) = own.unwrap_or_else(|| panic!("{} has no German title", feature.name));
            let line = format!("{name}: '{}',", title.replace('\u{a0}', "\\u00a0"));
            assert!(pages.contains(&line), "static/texts/de.js has no line {line}");
        }
        assert_eq!(GERMAN_TITLES.len(), FEATURES.len());
    }

    #[test]
    fn voided_attempts_are_listed_by_their_numbers() {
        assert_eq!(voided(En, &[]), "");
        assert_eq!(voided(En, &[1]), " (attempt 1 was declared void after a technical failure)");
        assert_eq!(voided(De, &[1, 2, 4]), " (die Versuche 1, 2 und 4 wurden nach technischen Fehlern gestrichen)");
    }

    #[test]
    fn days_numbers_and_rules_are_written_as_in_the_language() {
        assert_eq!(
            (day(En, "2026-03-05"), day(De, "2026-03-05")),
            ("5\u{a0}March\u{a0}2026".into(), "5.\u{a0}März\u{a0}2026".into())
        );
        assert_eq!((number(En, 0.25), number(De, -1.5)), ("0.25".into(), "\u{2212}1,5".into()));
        let three = StandardRule { in_a_row: 3, then_more: 2, at_most: Some(1) };
        assert_eq!(rule(En, &three), "3 passes in a row, then 2 more, within 1 session");
        assert_eq!(rule(De, &three), "3-mal in Folge bestanden, danach 2 weitere Male, innerhalb von 1 Sitzung");
    }
}
