//! Text with limits: names of people and things, codes, keys, file names.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Why a value was refused, in words for the user who sent it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {why}")]
pub struct Invalid {
    /// The value's name for people.
    pub what: &'static str,
    /// What was expected.
    pub why: String,
}

impl Invalid {
    /// Refuses `what`; `why` says what was expected instead.
    pub fn new(what: &'static str, why: impl Into<String>) -> Self {
        Self { what, why: why.into() }
    }
}

/// Text newtypes: parsed from a string, shown and sent as the same string. Parsing applies today's rules, so it is for
/// input.
macro_rules! text {
    ($($(#[$doc:meta])* $name:ident: $parse:expr;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema)]
        #[serde(try_from = "String", into = "String")]
        #[schema(value_type = String)]
        pub struct $name(String);

        impl $name {
            /// The text itself.
            pub fn as_str(&self) -> &str {
                &self.0
            }

            /// A text that was stored: it was accepted under the rules of its time, and stays readable.
            pub fn from_stored(text: String) -> Self {
                Self(text)
            }
        }

        impl FromStr for $name {
            type Err = Invalid;

            fn from_str(text: &str) -> Result<Self, Invalid> {
                let parse: fn(&str) -> Result<String, Invalid> = $parse;
                parse(text).map(Self)
            }
        }

        impl TryFrom<String> for $name {
            type Error = Invalid;

            fn try_from(text: String) -> Result<Self, Invalid> {
                text.parse()
            }
        }

        impl From<$name> for String {
            fn from(value: $name) -> String {
                value.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&self.0)
            }
        }
    )* };
}

text! {
    /// The name of a person or thing: 1 to 120 characters on one line, some of them visible, and none that controls the
    /// text around it.
    Name: |text| line("name", text, 1, 120);
    /// A login: 1 to 64 of `a–z 0–9 . _ - @ +`; capitals become lower case.
    Login: login;
    /// The short unique name of a box, trainee or task, for people and addresses: 1 to 64 of `a–z 0–9 -`.
    Code: code;
    /// A recording's original file name: 1 to 255 characters; folders before it are dropped, and characters that would
    /// mislead a reader become `_`.
    FileName: file_name;
    /// The name of a tracking program: 1 to 40 characters on one line.
    TrackerName: tracker;
    /// Text of several paragraphs, at most 10,000 characters.
    Paragraphs: |text| lines("text", text, 10_000);
    /// A remark, such as a comment on a moment: 1 to 2000 characters; line breaks are allowed.
    Remark: remark;
    /// The unit of a measured amount, such as `mm`: 1 to 12 characters on one line.
    UnitName: |text| line("unit", text, 1, 12);
}

impl Code {
    /// A code derived from a name: `Peg transfer (left)` becomes `peg-transfer-left`. A name without a Latin letter or
    /// a digit gives `fallback`.
    pub fn from_name(name: &Name, fallback: &'static str) -> Self {
        let mut code = String::new();
        for c in name.as_str().chars().filter_map(plain_character) {
            if c != '-' || !(code.is_empty() || code.ends_with('-')) {
                code.push(c);
            }
        }
        code.truncate(48); // room for a number when the code is taken
        let code = code.trim_end_matches('-');
        Self(if code.is_empty() { fallback.to_owned() } else { code.to_owned() })
    }

    /// This code with a number appended, for when the code is taken.
    pub fn numbered(&self, number: u32) -> Self {
        Self(format!("{}-{number}", self.0))
    }
}

/// An id or a code, as used in addresses. It is not checked: an unknown key is simply not found.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(transparent)]
#[schema(value_type = String)]
pub struct Key(String);

impl Key {
    /// The text itself.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<T: ToString + ?Sized> From<&T> for Key {
    fn from(id_or_code: &T) -> Self {
        Self(id_or_code.to_string())
    }
}

/// Words to search for: 1 to 8, of at most 120 characters in all.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct SearchWords(Vec<String>);

impl SearchWords {
    /// Each word as it may be written where it is found: small, with a capital, and in capitals. The database takes only
    /// the letters a–z for the same in both cases.
    pub fn variants(&self) -> Vec<[String; 3]> {
        let variants = |word: &String| {
            let (small, capitals) = (word.to_lowercase(), word.to_uppercase());
            let mut rest = small.chars();
            let first = rest.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
            let capital = first + rest.as_str();
            [small, capital, capitals]
        };
        self.0.iter().map(variants).collect()
    }
}

impl TryFrom<String> for SearchWords {
    type Error = Invalid;

    fn try_from(text: String) -> Result<Self, Invalid> {
        let words: Vec<String> = line("search", &text, 1, 120)?.split_whitespace().map(str::to_owned).collect();
        match words.len() {
            1..=8 => Ok(Self(words)),
            many => Err(Invalid::new("search", format!("has {many} words; expected 1 to 8"))),
        }
    }
}

/// The character of a code, or of a derived login, for this character: accents are dropped, apostrophes are omitted, anything else becomes a
/// dash.
pub(super) fn plain_character(c: char) -> Option<char> {
    Some(match c.to_lowercase().next().unwrap_or(c) {
        c @ ('a'..='z' | '0'..='9') => c,
        'à' | 'á' | 'â' | 'ã' | 'ä' | 'å' => 'a',
        'ç' | 'č' | 'ć' => 'c',
        'è' | 'é' | 'ê' | 'ë' | 'ě' | 'ę' => 'e',
        'ì' | 'í' | 'î' | 'ï' => 'i',
        'ñ' | 'ń' | 'ň' => 'n',
        'ò' | 'ó' | 'ô' | 'õ' | 'ö' | 'ø' => 'o',
        'ù' | 'ú' | 'û' | 'ü' | 'ů' => 'u',
        'ý' | 'ÿ' => 'y',
        'ß' | 'š' | 'ś' => 's',
        'ž' | 'ź' | 'ż' => 'z',
        '\'' | '’' => return None,
        _ => '-',
    })
}

/// A count with its noun: `1 file`, `2 files`. For nouns with a regular plural.
pub fn count_of(count: u64, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

fn line(what: &'static str, text: &str, min: usize, max: usize) -> Result<String, Invalid> {
    let text = text.trim();
    let length = text.chars().count();
    if length < min || length > max {
        return Err(Invalid::new(
            what,
            format!("has {}; expected {min} to {max}", count_of(length as u64, "character")),
        ));
    }
    if let Some(c) = text.chars().find(|c| c.is_control()) {
        return Err(Invalid::new(what, format!("contains the control character {}", c.escape_unicode())));
    }
    if let Some(c) = text.chars().find(|c| is_misleading(*c)) {
        return Err(Invalid::new(what, format!("contains the invisible character {}; remove it", c.escape_unicode())));
    }
    if has_visible(text) { Ok(text.to_owned()) } else { Err(Invalid::new(what, "has no visible character")) }
}

/// True for an invisible character that changes how the text around it is read: controls of direction, separators of
/// lines and paragraphs, and the byte-order mark. Joiners are none, since some scripts need them.
fn is_misleading(c: char) -> bool {
    matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{2028}' | '\u{2029}' | '\u{feff}')
}

/// True if a reader sees something of this text.
fn has_visible(text: &str) -> bool {
    text.chars().any(|c| !(c.is_whitespace() || c.is_control() || is_ignorable(c)))
}

/// True for a character without a shape of its own: Unicode's property `Default_Ignorable_Code_Point`, and the empty
/// Braille pattern.
fn is_ignorable(c: char) -> bool {
    matches!(
        c,
        '\u{ad}' | '\u{34f}' | '\u{61c}' | '\u{115f}'..='\u{1160}' | '\u{17b4}'..='\u{17b5}' | '\u{180b}'..='\u{180f}'
            | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{2800}' | '\u{3164}'
            | '\u{fe00}'..='\u{fe0f}' | '\u{feff}' | '\u{ffa0}' | '\u{fff0}'..='\u{fff8}' | '\u{1bca0}'..='\u{1bca3}'
            | '\u{1d173}'..='\u{1d17a}' | '\u{e0000}'..='\u{e0fff}'
    )
}

fn lines(what: &'static str, text: &str, max: usize) -> Result<String, Invalid> {
    let length = text.chars().count();
    if length > max {
        return Err(Invalid::new(
            what,
            format!("has {}; expected at most {max}", count_of(length as u64, "character")),
        ));
    }
    match text.chars().find(|c| c.is_control() && !matches!(c, '\n' | '\r' | '\t')) {
        Some(c) => Err(Invalid::new(what, format!("contains the control character {}", c.escape_unicode()))),
        None => Ok(text.trim_end().to_owned()),
    }
}

fn remark(text: &str) -> Result<String, Invalid> {
    let text = lines("text", text.trim(), 2_000)?;
    if has_visible(&text) { Ok(text) } else { Err(Invalid::new("text", "is empty; write something")) }
}

fn login(text: &str) -> Result<String, Invalid> {
    let text = line("login", text, 1, 64)?.to_ascii_lowercase();
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '.' | '_' | '-' | '@' | '+');
    if text.chars().all(allowed) { Ok(text) } else { Err(Invalid::new("login", "expected only a–z 0–9 . _ - @ +")) }
}

/// Tracker names are written into tables, where a spreadsheet would read `=…` as a formula.
fn tracker(text: &str) -> Result<String, Invalid> {
    let text = line("tracker", text, 1, 40)?;
    match text.chars().next().is_some_and(char::is_alphanumeric) {
        true => Ok(text),
        false => Err(Invalid::new("tracker", "expected a name that begins with a letter or a digit")),
    }
}

fn code(text: &str) -> Result<String, Invalid> {
    let text = line("code", text, 1, 64)?;
    if !text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-') {
        return Err(Invalid::new("code", "expected only a–z 0–9 and dashes"));
    }
    if uuid::Uuid::parse_str(&text).is_ok() {
        return Err(Invalid::new("code", "looks like an id; choose a name that people can say"));
    }
    Ok(text)
}

fn file_name(text: &str) -> Result<String, Invalid> {
    let last = text.rsplit(['/', '\\']).next().unwrap_or_default().trim();
    if !last.is_empty() && last.chars().all(|c| c.is_whitespace() || is_ignorable(c)) {
        return Ok("_".to_owned());
    }
    let shown: String = last.chars().map(|c| if is_misleading(c) { '_' } else { c }).collect();
    line("file name", &shown, 1, 255)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_code_is_what_people_would_write() {
        let code = |name: &str| Code::from_name(&name.parse().unwrap(), "box").to_string();
        assert_eq!(code("Peg transfer (left)"), "peg-transfer-left");
        assert_eq!(code("José O’Neill"), "jose-oneill");
        assert_eq!(code("手術"), "box");
    }

    #[test]
    fn a_code_never_looks_like_an_id() {
        assert!("0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44".parse::<Code>().is_err());
        assert!("0198c1f26a107d3e9f005c3b8f1d2a44".parse::<Code>().is_err());
    }

    #[test]
    fn a_file_name_keeps_no_folder() {
        assert_eq!("../../etc/clip.mp4".parse::<FileName>().unwrap().as_str(), "clip.mp4");
        assert_eq!(r"C:\clips\a.avi".parse::<FileName>().unwrap().as_str(), "a.avi");
        assert!("clips/".parse::<FileName>().is_err());
    }

    #[test]
    fn a_name_is_visible_and_does_not_control_the_text_around_it() {
        for bad in [
            "\u{200b}\u{200b}",
            "\u{202e}txt.exe",
            "x\u{2028}y",
            "\u{feff}x",
            "a\u{2066}b",
            "\u{ad} \u{2060}",
            "\u{3164}",
        ] {
            assert!(bad.parse::<Name>().is_err(), "{bad:?}");
            assert!(serde_json::from_value::<Name>(bad.into()).is_err(), "{bad:?}");
            assert_eq!(Name::from_stored(bad.to_owned()).as_str(), bad, "an earlier name stays readable");
        }
        assert!("\u{200b}\n\u{2060}".parse::<Remark>().is_err());
        // Joiners of Persian and of an emoji; a Hebrew name; a name with a soft hyphen.
        for good in ["می\u{200c}خواهم", "👩\u{200d}⚕️", "דנה", "Grasper\u{ad}kurs"] {
            assert_eq!(good.parse::<Name>().unwrap().as_str(), good);
        }
    }

    #[test]
    fn a_file_name_never_misleads_and_is_never_refused_for_it() {
        for (given, stored) in [
            ("\u{202e}gpm.exe", "_gpm.exe"),
            ("a\u{2028}b.mp4", "a_b.mp4"),
            ("\u{feff}clip.mp4", "_clip.mp4"),
            ("\u{200b}\u{200b}", "_"),
            ("\u{200b} \u{200b}", "_"),
        ] {
            assert_eq!(given.parse::<FileName>().unwrap().as_str(), stored);
        }
    }

    proptest! {
        #[test]
        fn a_code_made_of_any_name_is_a_code(text in "\\PC{1,120}") {
            if let Ok(name) = text.parse::<Name>() {
                let code = Code::from_name(&name, "task");
                prop_assert_eq!(code.as_str().parse::<Code>(), Ok(code.clone()));
                prop_assert_eq!(code.numbered(u32::MAX).as_str().parse::<Code>(), Ok(code.numbered(u32::MAX)));
            }
        }

        #[test]
        fn parsing_is_idempotent(text in "\\PC{0,300}") {
            if let Ok(name) = text.parse::<FileName>() {
                prop_assert_eq!(name.as_str().parse::<FileName>(), Ok(name.clone()));
            }
        }
    }
}
