//! When the service's certificate ends, and when the log warns of it.

use std::time::Duration;

use rustls::RootCertStore;
use rustls::client::verify_server_cert_signed_by_trust_anchor;
use rustls::crypto::CryptoProvider;
use rustls::pki_types::{CertificateDer, UnixTime};
use rustls::server::ParsedCertificate;

use crate::time::{Clock, millis};

/// Time before the end of a certificate that the log warns of it.
const WARNING_TIME: Duration = Duration::from_secs(14 * 86_400);
/// Interval of the warnings.
const WARNING_INTERVAL: Duration = Duration::from_secs(86_400);
/// The beginning of the year 10000, since the epoch: no certificate states a later end.
const AFTER_ALL_ENDS: Duration = Duration::from_secs(253_402_300_800);

/// The certificate that was looked at last, and when, monotonic ms.
#[derive(Debug, Default)]
pub(super) struct EndWarnings(Option<(CertificateDer<'static>, i64)>);

impl EndWarnings {
    /// The end of this certificate, epoch ms, if a warning is due: it ends within 14 days or has ended, and it is
    /// another certificate than at the last call, or a day has passed.
    pub fn due(
        &mut self,
        certificate: &CertificateDer<'static>,
        provider: &CryptoProvider,
        clock: &dyn Clock,
    ) -> Option<i64> {
        let now_ms = clock.monotonic_ms();
        let is_recent = |(seen, at_ms): &(CertificateDer<'static>, i64)| {
            seen == certificate && now_ms - at_ms < millis(WARNING_INTERVAL)
        };
        if self.0.as_ref().is_some_and(is_recent) {
            return None;
        }
        self.0 = Some((certificate.clone(), now_ms));
        end_ms(certificate, provider).filter(|end_ms| end_ms - clock.now_ms() < millis(WARNING_TIME))
    }
}

/// When a certificate ends, epoch ms. `None` if it cannot be read.
fn end_ms(certificate: &CertificateDer<'_>, provider: &CryptoProvider) -> Option<i64> {
    let certificate = ParsedCertificate::try_from(certificate).ok()?;
    // The verifier looks at the times before it looks for the issuer, and its error states the end.
    let verified = verify_server_cert_signed_by_trust_anchor(
        &certificate,
        &RootCertStore::empty(),
        &[],
        UnixTime::since_unix_epoch(AFTER_ALL_ENDS),
        provider.signature_verification_algorithms.all,
    );
    match verified {
        Err(rustls::Error::InvalidCertificate(rustls::CertificateError::ExpiredContext { not_after, .. })) => {
            i64::try_from(not_after.as_secs()).ok()?.checked_mul(1000)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use rustls::crypto::ring;
    use rustls::pki_types::pem::PemObject;

    use super::*;
    use crate::time::{ManualClock, from_rfc3339};

    /// A certificate that is its own issuer, from 2026-11-29T02:03:07Z to 2026-12-29T02:03:07Z.
    const CERTIFICATE: &str = "\
-----BEGIN CERTIFICATE-----
MIIBfTCCASOgAwIBAgIUBAR2caDz2cbJ8S6Zgmp7LxkJ11AwCgYIKoZIzj0EAwIw
FDESMBAGA1UEAwwJbG9jYWxob3N0MB4XDTI2MTEyOTAyMDMwN1oXDTI2MTIyOTAy
MDMwN1owFDESMBAGA1UEAwwJbG9jYWxob3N0MFkwEwYHKoZIzj0CAQYIKoZIzj0D
AQcDQgAEZj4uDp+lONcobbtsjOKbxxiSnfcZqkWnYgYfYGI/qj2DpYaKvq+Ezbme
SICRs63ja2CcNgfvVbr/avp5JH+x4aNTMFEwHQYDVR0OBBYEFNQSpFY59Nhpd3vd
LzkSDA5LZkSNMB8GA1UdIwQYMBaAFNQSpFY59Nhpd3vdLzkSDA5LZkSNMA8GA1Ud
EwEB/wQFMAMBAf8wCgYIKoZIzj0EAwIDSAAwRQIgM3j/8qtP8qCM2nzrD+7OLAr3
ejzNqPBIpzgQPyX1JdICIQDDve3Eilm13BXkF8kSNL1/f2VcI5oOEmDH4IrctePD
WQ==
-----END CERTIFICATE-----
";
    const END: &str = "2026-12-29T02:03:07Z";

    #[test]
    fn the_log_warns_in_the_last_14_days_once_a_day() {
        let provider = ring::default_provider();
        let certificate = CertificateDer::from_pem_slice(CERTIFICATE.as_bytes()).unwrap();
        let day = Duration::from_secs(86_400);
        let at_end_ms = from_rfc3339(END).unwrap();
        let clock = ManualClock::at(at_end_ms - 15 * millis(day));
        let mut warnings = EndWarnings::default();
        assert_eq!(warnings.due(&certificate, &provider, &*clock), None);
        clock.advance(2 * day);
        assert_eq!(warnings.due(&certificate, &provider, &*clock), Some(at_end_ms));
        clock.advance(day / 2);
        assert_eq!(warnings.due(&certificate, &provider, &*clock), None, "a warning a day");
        clock.advance(day / 2);
        assert_eq!(warnings.due(&certificate, &provider, &*clock), Some(at_end_ms));
        let unreadable = CertificateDer::from(vec![0x30, 0]);
        assert_eq!(warnings.due(&unreadable, &provider, &*clock), None);
        assert_eq!(warnings.due(&certificate, &provider, &*clock), Some(at_end_ms), "at once for another certificate");
        clock.advance(30 * day);
        assert_eq!(warnings.due(&certificate, &provider, &*clock), Some(at_end_ms), "it has ended");
    }
}
