//! TLS of the service: its certificate and key come from files, which are read again when they change.
//!
//! Programs that renew certificates replace both files, one after the other. So the files are looked at regularly, and
//! a pair is used only if key and certificate belong together. New connections get the new certificate; open ones keep
//! theirs. A pair that cannot be used leaves the earlier one in force.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use tokio_rustls::TlsAcceptor;

use super::certificate_end::EndWarnings;
use crate::shutdown::Shutdown;
use crate::time::{SharedClock, to_rfc3339};

/// How often the files are looked at.
const CHECK_INTERVAL: Duration = Duration::from_secs(10);
/// Names of HTTP/2 and HTTP/1.1 in the handshake (ALPN), the preferred one first.
const PROTOCOLS: [&[u8]; 2] = [HTTP2, b"http/1.1"];
/// Name of HTTP/2 in the handshake.
pub const HTTP2: &[u8] = b"h2";

/// The section `[tls]` of the settings file. With a certificate the service speaks HTTPS, without one plain HTTP.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TlsSettings {
    /// File with the certificate, followed by the certificates of its issuers (PEM).
    pub certificate: Option<PathBuf>,
    /// File with the certificate's private key (PEM).
    pub key: Option<PathBuf>,
    /// A further address for plain HTTP, such as `0.0.0.0:80`. Its requests are redirected to HTTPS.
    pub redirect_listen: Option<SocketAddr>,
}

/// Why a certificate cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// A file cannot be read.
    #[error("cannot read `{path}`: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The key can be read with a passphrase only.
    #[error(
        "`{path}` is a key with a passphrase, which the service cannot ask for; write the key without one: \
         `openssl pkey -in {path} -out NEW-FILE`, let only the service's user read it, and name NEW-FILE in the settings"
    )]
    Encrypted {
        /// The file.
        path: PathBuf,
    },
    /// A file is not PEM, or does not contain what it should.
    #[error("`{path}` has no usable {wanted}: {why}; expected a PEM file")]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What was looked for.
        wanted: &'static str,
        /// What is wrong.
        why: String,
    },
    /// The key is not the certificate's, or of a kind that TLS does not use.
    #[error("the key in `{key}` does not fit the certificate in `{certificate}`: {why}")]
    Pair {
        /// File of the certificate.
        certificate: PathBuf,
        /// File of the key.
        key: PathBuf,
        /// What is wrong.
        why: rustls::Error,
    },
}

/// The service's certificate, kept current with its files. Clones share it.
#[derive(Clone, Debug)]
pub struct ServerCertificate(Arc<CertificateState>);

#[derive(Debug)]
struct CertificateState {
    certificate: PathBuf,
    key: PathBuf,
    provider: Arc<CryptoProvider>,
    current: RwLock<Arc<CertifiedKey>>,
}

/// SHA-256 of the content of both files.
type FilesHash = [u8; 32];

impl ServerCertificate {
    /// Reads the certificate that the settings name; `None` if they name none.
    pub async fn load(settings: &TlsSettings) -> Result<Option<Self>, CertificateError> {
        let (Some(certificate), Some(key)) = (settings.certificate.clone(), settings.key.clone()) else {
            return Ok(None);
        };
        let provider = Arc::new(ring::default_provider());
        let files = CertificateFiles::read(&certificate, &key).await?;
        let current = RwLock::new(Arc::new(files.certified_key(&certificate, &key, &provider)?));
        Ok(Some(Self(Arc::new(CertificateState { certificate, key, provider, current }))))
    }

    /// Accepts TLS connections, with HTTP/2 if the client can.
    pub fn acceptor(&self) -> Result<TlsAcceptor, rustls::Error> {
        let mut config = rustls::ServerConfig::builder_with_provider(self.0.provider.clone())
            .with_safe_default_protocol_versions()?
            .with_no_client_auth()
            .with_cert_resolver(self.0.clone());
        config.alpn_protocols = PROTOCOLS.map(<[u8]>::to_vec).to_vec();
        Ok(TlsAcceptor::from(Arc::new(config)))
    }

    /// Reads the files again whenever they change, until `stop`. Warns in the log if the certificate ends soon.
    pub async fn keep_current(self, clock: SharedClock, stop: Shutdown) {
        let mut warnings = EndWarnings::default();
        let mut seen = None;
        let mut before: Option<String> = None;
        let mut is_reported = false;
        loop {
            self.0.warn_of_end(&mut warnings, &clock);
            tokio::select! {
                () = stop.begun() => return,
                () = clock.sleep(CHECK_INTERVAL) => {}
            }
            let problem = self.0.reload(&mut seen).await.err().map(|error| error.to_string());
            is_reported &= problem == before;
            // Reported at the second look: the first may see the one file replaced and the other not yet.
            if let Some(why) = problem.as_ref().filter(|_| problem == before && !is_reported) {
                tracing::error!(why, "new certificate cannot be used; the earlier one stays in use");
                is_reported = true;
            }
            before = problem;
        }
    }
}

impl CertificateState {
    fn warn_of_end(&self, warnings: &mut EndWarnings, clock: &SharedClock) {
        let current = self.current.read().unwrap_or_else(PoisonError::into_inner).clone();
        let end_ms = current.cert.first().and_then(|own| warnings.due(own, &self.provider, &**clock));
        let Some(end_ms) = end_ms else { return };
        let (ends_at, certificate) = (to_rfc3339(end_ms), self.certificate.display());
        if end_ms < clock.now_ms() {
            tracing::error!(%certificate, ends_at, "the certificate has expired; renew it");
        } else {
            tracing::warn!(%certificate, ends_at, "the certificate expires in less than 14 days; renew it");
        }
    }

    /// Uses the files' content if it differs from what was `seen` last. A failure is tried again at the next call.
    async fn reload(&self, seen: &mut Option<FilesHash>) -> Result<(), CertificateError> {
        let files = CertificateFiles::read(&self.certificate, &self.key).await?;
        let hash = files.hash();
        if seen.replace(hash) == Some(hash) {
            return Ok(());
        }
        let read = files.certified_key(&self.certificate, &self.key, &self.provider);
        let read = read.inspect_err(|_| *seen = None)?;
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        if current.cert != read.cert {
            tracing::info!(certificate = %self.certificate.display(), "certificate changed; new connections use it");
        }
        *current = Arc::new(read);
        Ok(())
    }
}

impl ResolvesServerCert for CertificateState {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        Some(self.current.read().unwrap_or_else(PoisonError::into_inner).clone())
    }
}

/// The content of both files.
struct CertificateFiles {
    certificate: Vec<u8>,
    key: Vec<u8>,
}

impl CertificateFiles {
    async fn read(certificate: &Path, key: &Path) -> Result<Self, CertificateError> {
        let read = async |path: &Path| {
            tokio::fs::read(path).await.map_err(|source| CertificateError::Read { path: path.to_owned(), source })
        };
        Ok(Self { certificate: read(certificate).await?, key: read(key).await? })
    }

    fn hash(&self) -> FilesHash {
        let lengths = [self.certificate.len() as u64, self.key.len() as u64].map(u64::to_be_bytes).concat();
        Sha256::new().chain_update(lengths).chain_update(&self.certificate).chain_update(&self.key).finalize().into()
    }

    fn certified_key(
        &self,
        certificate: &Path,
        key: &Path,
        provider: &CryptoProvider,
    ) -> Result<CertifiedKey, CertificateError> {
        let unusable =
            |path: &Path, wanted, why: String| CertificateError::Unusable { path: path.to_owned(), wanted, why };
        let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_slice_iter(&self.certificate)
            .collect::<Result<_, _>>()
            .map_err(|error| unusable(certificate, "certificate", error.to_string()))?;
        if chain.is_empty() {
            return Err(unusable(certificate, "certificate", "it contains none".to_owned()));
        }
        if is_encrypted(&self.key) {
            return Err(CertificateError::Encrypted { path: key.to_owned() });
        }
        let private = PrivateKeyDer::from_pem_slice(&self.key)
            .map_err(|error| unusable(key, "private key", error.to_string()))?;
        CertifiedKey::from_der(chain, private, provider).map_err(|why| CertificateError::Pair {
            certificate: certificate.to_owned(),
            key: key.to_owned(),
            why,
        })
    }
}

/// True for a key in PEM that is encrypted, in the present format (PKCS#8) or the earlier one of OpenSSL.
fn is_encrypted(key: &[u8]) -> bool {
    let has = |mark: &[u8]| key.windows(mark.len()).any(|part| part == mark);
    has(b"-----BEGIN ENCRYPTED PRIVATE KEY-----") || has(b"Proc-Type: 4,ENCRYPTED")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn files_that_cannot_be_used_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| Some(folder.path().join(name));
        let settings =
            TlsSettings { certificate: path("certificate.pem"), key: path("key.pem"), redirect_listen: None };
        let missing = ServerCertificate::load(&settings).await.unwrap_err().to_string();
        assert!(missing.starts_with("cannot read") && missing.contains("certificate.pem"), "{missing}");
        for name in ["certificate.pem", "key.pem"] {
            std::fs::write(folder.path().join(name), "not PEM").unwrap();
        }
        let empty = ServerCertificate::load(&settings).await.unwrap_err().to_string();
        assert!(empty.contains("certificate.pem` has no usable certificate"), "{empty}");
        assert!(ServerCertificate::load(&TlsSettings::default()).await.unwrap().is_none());
    }

    #[tokio::test]
    async fn a_key_with_a_passphrase_is_refused_with_the_command_that_removes_it() {
        let folder = tempfile::tempdir().unwrap();
        let (certificate, key) = (folder.path().join("certificate.pem"), folder.path().join("key.pem"));
        std::fs::write(&certificate, "-----BEGIN CERTIFICATE-----\nMAA=\n-----END CERTIFICATE-----\n").unwrap();
        for head in ["ENCRYPTED PRIVATE KEY-----", "RSA PRIVATE KEY-----\nProc-Type: 4,ENCRYPTED"] {
            std::fs::write(&key, format!("-----BEGIN {head}\nMAA=\n")).unwrap();
            let (certificate, key) = (Some(certificate.clone()), Some(key.clone()));
            let settings = TlsSettings { certificate, key, redirect_listen: None };
            let refused = ServerCertificate::load(&settings).await.unwrap_err().to_string();
            assert!(refused.contains("passphrase") && refused.contains("openssl pkey -in"), "{refused}");
        }
    }
}
