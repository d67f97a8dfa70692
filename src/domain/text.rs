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

/// Text newtypes: parsed from a string, shown and sent as the same string.
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
    /// The name of a person or thing: 1 to 120 characters on one line, without control characters.
    Name: |text| line("name", text, 1, 120);
    /// A login: 1 to 64 of `a–z 0–9 . _ - @ +`; capitals become lower case.
    Login: login;
    /// The short unique name of a box, trainee or task, for people and addresses: 1 to 64 of `a–z 0–9 -`.
    Code: code;
    /// A recording's original file name: 1 to 255 characters; folders before it are dropped.
    FileName: file_name;
    /// The name of a tracking program: 1 to 40 characters on one line.
    TrackerName: tracker;
    /// Text of several paragraphs, at most 10,000 characters.
    Paragraphs: |text| lines("text", text, 10_000);
    /// A remark, such as a comment on a moment: 1 to 2000 characters; line breaks are allowed.
    Remark: remark;
}

impl Code {
    /// A code derived from a name: `Peg transfer (left)` becomes `peg-transfer-left`. A name without a Latin letter or
    /// a digit gives `fallback`.
    pub fn from_name(name: &Name, fallback: &'static str) -> Self {
        let mut code = String::new();
        for c in name.as_str().chars().filter_map(code_character) {
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

/// The character of a code for this character: accents are dropped, apostrophes are omitted, anything else becomes a
/// dash.
fn code_character(c: char) -> Option<char> {
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

fn line(what: &'static str, text: &str, min: usize, max: usize) -> Result<String, Invalid> {
    let text = text.trim();
    let length = text.chars().count();
    if length < min || length > max {
        return Err(Invalid::new(what, format!("has {length} characters; expected {min} to {max}")));
    }
    match text.chars().find(|c| c.is_control()) {
        Some(c) => Err(Invalid::new(what, format!("contains the control character {}", c.escape_unicode()))),
        None => Ok(text.to_owned()),
    }
}

fn lines(what: &'static str, text: &str, max: usize) -> Result<String, Invalid> {
    let length = text.chars().count();
    if length > max {
        return Err(Invalid::new(what, format!("has {length} characters; expected at most {max}")));
    }
    match text.chars().find(|c| c.is_control() && !matches!(c, '\n' | '\r' | '\t')) {
        Some(c) => Err(Invalid::new(what, format!("contains the control character {}", c.escape_unicode()))),
        None => Ok(text.trim_end().to_owned()),
    }
}

fn remark(text: &str) -> Result<String, Invalid> {
    let text = lines("text", text.trim(), 2_000)?;
    if text.is_empty() { Err(Invalid::new("text", "is empty; write something")) } else { Ok(text) }
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
    let last = text.rsplit(['/', '\\']).next().unwrap_or_default();
    line("file name", last, 1, 255)
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
