//! The signed file of a certificate: a PDF whose last line, a comment, is its signature.
//!
//! ```text
//! %TrocarCertificate v1 content=OFFSET+LENGTH key=KEY signature=SIGNATURE
//! ```
//!
//! `content` says which bytes of the file are its [`CertificateContent`] as JSON, so that the file can be read without a
//! parser of PDF. The signature is that of all bytes before it, the beginning of this line included. What follows it, 128
//! lower-case hexadecimal digits and one line end, has exactly one form. So no byte of the file can be changed, added or
//! left out unnoticed.

use super::CertificateContent;
use super::key::{CertificateKeyId, CertificatePublicKey, CertificateSigner};

/// The beginning of the last line.
const MARK: &str = "%TrocarCertificate v1 ";
/// What files that once were a certificate still contain somewhere, even if one byte of the last line was changed.
const TRACE: &[u8] = b"TrocarCertificate";
const SIGNATURE_DIGITS: usize = 128;
/// Longest last line, bytes.
const MAX_LINE: usize = 320;

/// Largest file, bytes. One page with its part of a font and a logo has less than 300 KB.
pub const MAX_FILE_BYTES: usize = 2 * 1024 * 1024;

/// What the signature of a file says.
#[derive(Clone, Debug, PartialEq)]
pub enum SignatureVerdict {
    /// One of the keys signed exactly these bytes.
    Genuine {
        /// What the certificate says.
        content: Box<CertificateContent>,
        /// The key that signed it.
        key: CertificateKeyId,
    },
    /// It is or was a certificate, and is not as it was signed.
    Changed,
    /// It names a key that is not among the known ones.
    UnknownKey {
        /// The key that it names.
        key: CertificateKeyId,
    },
    /// It is no certificate of this program.
    NotACertificate,
}

/// The parts of a file's last line.
struct LastLine<'f> {
    /// All bytes that are signed.
    signed: &'f [u8],
    content: &'f [u8],
    key: CertificateKeyId,
    signature: Vec<u8>,
}

/// Signs a PDF. `content_at`: where its bytes contain `content` as JSON.
pub fn sign(mut pdf: Vec<u8>, content_at: (usize, usize), signer: &CertificateSigner) -> Vec<u8> {
    if !pdf.ends_with(b"\n") {
        pdf.push(b'\n');
    }
    let (offset, length) = content_at;
    let key = signer.public().id();
    pdf.extend_from_slice(format!("{MARK}content={offset}+{length} key={key} signature=").as_bytes());
    let signature: String = signer.sign(&pdf).iter().map(|byte| format!("{byte:02x}")).collect();
    pdf.extend_from_slice(signature.as_bytes());
    pdf.push(b'\n');
    pdf
}

/// What the signature of a file says, if these keys are known.
pub fn verify(file: &[u8], keys: &[CertificatePublicKey]) -> SignatureVerdict {
    let Some(line) = (file.len() <= MAX_FILE_BYTES).then(|| read_last_line(file)).flatten() else {
        let has_trace = file.windows(TRACE.len()).any(|window| window == TRACE);
        return if has_trace { SignatureVerdict::Changed } else { SignatureVerdict::NotACertificate };
    };
    let Some(key) = keys.iter().find(|key| key.id() == line.key) else {
        return SignatureVerdict::UnknownKey { key: line.key };
    };
    if !key.verifies(line.signed, &line.signature) {
        return SignatureVerdict::Changed;
    }
    match serde_json::from_slice(line.content) {
        Ok(content) => SignatureVerdict::Genuine { content: Box::new(content), key: line.key },
        Err(_) => SignatureVerdict::Changed,
    }
}

/// Reads the last line strictly; `None` if it has any other form than [`sign`] gives it.
fn read_last_line(file: &[u8]) -> Option<LastLine<'_>> {
    let body = file.strip_suffix(b"\n")?;
    let tail = &body[body.len().saturating_sub(MAX_LINE)..];
    let start = body.len() - tail.len() + tail.iter().rposition(|byte| *byte == b'\n')? + 1;
    let line = std::str::from_utf8(&body[start..]).ok()?.strip_prefix(MARK)?;
    let (facts, digits) = line.split_once(" signature=")?;
    let (place, key) = facts.strip_prefix("content=")?.split_once(" key=")?;
    let (offset, length) = place.split_once('+')?;
    let (offset, length): (usize, usize) = (offset.parse().ok()?, length.parse().ok()?);
    let content = file[..start].get(offset..offset.checked_add(length)?)?;
    let signature = bytes_of(digits)?;
    Some(LastLine { signed: &file[..body.len() - SIGNATURE_DIGITS], content, key: key.parse().ok()?, signature })
}

/// The bytes of exactly 128 lower-case hexadecimal digits.
fn bytes_of(digits: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| match byte {
        b'0'..=b'9' => Some(byte - b'0'),
        b'a'..=b'f' => Some(byte - b'a' + 10),
        _ => None,
    };
    let pairs = digits.as_bytes().chunks_exact(2);
    if digits.len() != SIGNATURE_DIGITS {
        return None;
    }
    pairs.map(|pair| Some(digit(pair[0])? << 4 | digit(pair[1])?)).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::domain::certificate::{
        CONTENT_FORMAT, CertificateBasis, CertificateCode, CertificateLanguage, CertifiedSession, CertifiedStandard,
    };

    pub(crate) fn content(signer: &CertificateSigner) -> CertificateContent {
        let code: CertificateCode = "0a1b2c3d4e5f6g7h8j9kambncp".parse().unwrap();
        let session =
            CertifiedSession { number: 3, recorded_on: "2026-11-30".into(), day_known: true, supervision: None };
        CertificateContent {
            format: CONTENT_FORMAT,
            address: format!("https://trocar.example/verify/{code}"),
            code,
            language: CertificateLanguage::En,
            centre: Some("Skills lab".into()),
            trainee: "Ada Novák".into(),
            task: "Peg transfer".into(),
            standard: CertifiedStandard {
                version: 2,
                set_on: "2026-11-01".into(),
                limits: vec!["Duration: at most 50 s".into()],
                rule: None,
            },
            basis: CertificateBasis::Charts,
            exam: None,
            earned_on: "2026-11-30".into(),
            sessions: vec![session],
            program: "0.1.0".into(),
            measurement: "1".into(),
            issuer: "Ines".into(),
            issued_on: "2026-11-30".into(),
            key: signer.public().id(),
        }
    }

    fn signed(signer: &CertificateSigner) -> Vec<u8> {
        let json = serde_json::to_vec(&content(signer)).unwrap();
        let pdf = [b"%PDF-1.7\n".as_slice(), &json, b"\n%%EOF"].concat();
        sign(pdf, (9, json.len()), signer)
    }

    #[test]
    fn a_signed_file_is_genuine_and_says_what_was_signed() {
        let (signer, other) =
            (CertificateSigner::from_seed([7; 32]).unwrap(), CertificateSigner::from_seed([8; 32]).unwrap());
        let file = signed(&signer);
        let keys = [other.public(), signer.public()];
        let key = signer.public().id();
        let genuine = SignatureVerdict::Genuine { content: Box::new(content(&signer)), key: key.clone() };
        assert_eq!(verify(&file, &keys), genuine);
        assert_eq!(verify(&file, &keys[..1]), SignatureVerdict::UnknownKey { key });
        assert_eq!(verify(b"%PDF-1.7\n%%EOF\n", &keys), SignatureVerdict::NotACertificate);
        assert_eq!(verify(b"", &keys), SignatureVerdict::NotACertificate);
    }

    /// Every byte, with every other value in the last line and three others elsewhere.
    #[test]
    fn no_byte_can_be_changed_added_or_left_out() {
        let signer = CertificateSigner::from_seed([7; 32]).unwrap();
        let (file, keys) = (signed(&signer), [signer.public()]);
        let is_refused = |file: &[u8]| !matches!(verify(file, &keys), SignatureVerdict::Genuine { .. });
        let line = file.len() - 300;
        for at in 0..file.len() {
            let flips: Vec<u8> = if at >= line { (1..=255).collect() } else { vec![1, 0x20, 0x80] };
            for flip in flips {
                let mut changed = file.clone();
                changed[at] ^= flip;
                assert!(is_refused(&changed), "byte {at} ^ {flip}");
            }
            let without = [&file[..at], &file[at + 1..]].concat();
            assert!(is_refused(&without), "without byte {at}");
            let with = [&file[..at], b"0", &file[at..]].concat();
            assert!(is_refused(&with), "with a byte before {at}");
            assert!(is_refused(&file[..at]) && is_refused(&file[at + 1..]), "cut at {at}");
        }
        for more in ["\n", "\r\n", " ", "%%EOF\n"] {
            assert!(is_refused(&[&file, more.as_bytes()].concat()));
        }
        let twice = [&file[..], &file[..]].concat();
        assert!(is_refused(&twice));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400), cut in 0_usize..500) {
            let signer = CertificateSigner::from_seed([7; 32]).unwrap();
            let file = signed(&signer);
            let mixed = [&file[..cut.min(file.len())], &bytes, &file[cut.min(file.len())..]].concat();
            let is_genuine = matches!(verify(&mixed, &[signer.public()]), SignatureVerdict::Genuine { .. });
            prop_assert_eq!(is_genuine, bytes.is_empty());
        }
    }
}
