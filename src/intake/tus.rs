//! The headers of tus 1.0.0: <https://tus.io/protocols/resumable-upload>.
//!
//! This module only parses text into values; [`super`] receives the bytes.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha1::Digest;
use sha2::Sha256;

/// The protocol's version.
pub const VERSION: &str = "1.0.0";
/// Supported extensions of the protocol.
pub const EXTENSIONS: &str = "creation,creation-with-upload,termination,checksum,expiration";
/// Supported checksums.
pub const CHECKSUMS: &str = "sha1,sha256";
/// Maximum length of `Upload-Metadata`, bytes.
const MAX_METADATA: usize = 8 * 1024;

/// What is wrong with a header, for people.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeaderProblem {
    /// Metadata that is not a list of pairs of key and base64.
    #[error("Upload-Metadata must be `key base64, key base64, …` with UTF-8 text of at most 8 KiB; wrong at `{0}`")]
    Metadata(String),
    /// A checksum that cannot be parsed or is not supported.
    #[error("Upload-Checksum must be `sha1 BASE64` or `sha256 BASE64` of the bytes in this request")]
    Checksum,
}

/// An upload's metadata: the sender's description of the recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Metadata {
    /// The file's name on the sender's machine.
    pub filename: Option<String>,
    /// The trainee: id or code.
    pub trainee: Option<String>,
    /// The task: id or code.
    pub task: Option<String>,
    /// The box: id or code.
    pub box_: Option<String>,
    /// When it was recorded, RFC 3339.
    pub recorded_at: Option<String>,
    /// The true frame rate, Hz.
    pub true_frame_rate_hz: Option<String>,
    /// The true duration, s.
    pub true_duration_s: Option<String>,
}

impl Metadata {
    /// Parses `Upload-Metadata`; keys of other programs (`filetype`, `relativePath`…) are ignored.
    pub fn parse(header: &str) -> Result<Self, HeaderProblem> {
        if header.len() > MAX_METADATA {
            return Err(HeaderProblem::Metadata("its length".to_owned()));
        }
        let mut metadata = Self::default();
        for pair in header.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
            let (key, value) = pair.split_once(' ').unwrap_or((pair, ""));
            let value = text(value.trim()).ok_or_else(|| HeaderProblem::Metadata(key.chars().take(40).collect()))?;
            metadata.set(key, value);
        }
        Ok(metadata)
    }

    fn set(&mut self, key: &str, value: String) {
        let field = match key {
            "filename" => &mut self.filename,
            "trainee" => &mut self.trainee,
            "task" => &mut self.task,
            "box" => &mut self.box_,
            "recorded_at" => &mut self.recorded_at,
            "true_frame_rate_hz" => &mut self.true_frame_rate_hz,
            "true_duration_s" => &mut self.true_duration_s,
            _ => return,
        };
        *field = (!value.is_empty()).then_some(value);
    }
}

fn text(base64: &str) -> Option<String> {
    String::from_utf8(STANDARD.decode(base64).ok()?).ok()
}

/// The checksum that a request's bytes must have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// SHA-1: not safe against an attacker, but tus requires its support.
    Sha1([u8; 20]),
    /// SHA-256.
    Sha256([u8; 32]),
}

impl Checksum {
    /// Parses `Upload-Checksum`.
    pub fn parse(header: &str) -> Result<Self, HeaderProblem> {
        let (name, value) = header.trim().split_once(' ').ok_or(HeaderProblem::Checksum)?;
        let bytes = STANDARD.decode(value.trim()).map_err(|_| HeaderProblem::Checksum)?;
        let parsed = match name {
            "sha1" => bytes.try_into().map(Checksum::Sha1).ok(),
            "sha256" => bytes.try_into().map(Checksum::Sha256).ok(),
            _ => None,
        };
        parsed.ok_or(HeaderProblem::Checksum)
    }

    /// Begins to compute the checksum of arriving bytes.
    pub fn begin(self) -> RunningSum {
        match self {
            Checksum::Sha1(expected) => RunningSum::Sha1(sha1::Sha1::new(), expected),
            Checksum::Sha256(expected) => RunningSum::Sha256(Sha256::new(), expected),
        }
    }
}

/// The checksum of the bytes so far, and its expected final value.
pub enum RunningSum {
    /// See [`Checksum::Sha1`].
    Sha1(sha1::Sha1, [u8; 20]),
    /// See [`Checksum::Sha256`].
    Sha256(Sha256, [u8; 32]),
}

impl RunningSum {
    /// Adds bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        match self {
            RunningSum::Sha1(sum, _) => sum.update(bytes),
            RunningSum::Sha256(sum, _) => sum.update(bytes),
        }
    }

    /// True if the bytes match the client's checksum.
    pub fn matches(self) -> bool {
        match self {
            RunningSum::Sha1(sum, expected) => sum.finalize()[..] == expected,
            RunningSum::Sha256(sum, expected) => sum.finalize()[..] == expected,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn metadata_of_a_browser_are_read_and_foreign_keys_passed_over() {
        let header = "filename YSBiLm1wNA==,filetype dmlkZW8vbXA0, trainee YWRh,is_confidential,task cGVn,box Ym94LTE=,true_frame_rate_hz MTYuNA==";
        let expected = Metadata {
            filename: Some("a b.mp4".to_owned()),
            trainee: Some("ada".to_owned()),
            task: Some("peg".to_owned()),
            box_: Some("box-1".to_owned()),
            true_frame_rate_hz: Some("16.4".to_owned()),
            ..Metadata::default()
        };
        assert_eq!(Metadata::parse(header), Ok(expected));
        assert_eq!(Metadata::parse(""), Ok(Metadata::default()));
    }

    #[test]
    fn metadata_that_are_no_base64_or_no_text_are_named() {
        assert_eq!(Metadata::parse("trainee a!b"), Err(HeaderProblem::Metadata("trainee".to_owned())));
        assert_eq!(Metadata::parse("task /w=="), Err(HeaderProblem::Metadata("task".to_owned())));
        assert!(Metadata::parse(&"a ,".repeat(10_000)).is_err());
    }

    #[test]
    fn only_the_meant_bytes_match() {
        // From the protocol's own example: "hello world".
        for header in ["sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0=", "sha256 uU0nuZNNPgilLlLX2n2r+sSE7+N6U4DukIj3rOLvzek="] {
            let mut sum = Checksum::parse(header).unwrap().begin();
            sum.update(b"hello ");
            sum.update(b"world");
            assert!(sum.matches(), "{header}");
            assert!(!Checksum::parse(header).unwrap().begin().matches());
        }
    }

    #[test]
    fn unknown_or_short_checksums_are_refused() {
        for header in ["md5 AAAA", "sha1", "sha1 AAAA", "sha256 Kq5sNclPz7QV2+lfQIuc6R7oRu0=", "sha1 ???"] {
            assert_eq!(Checksum::parse(header), Err(HeaderProblem::Checksum), "{header}");
        }
    }

    proptest! {
        #[test]
        fn no_header_panics(text in ".{0,200}") {
            let _ = Metadata::parse(&text);
            let _ = Checksum::parse(&text);
        }
    }
}
