//! The provider of single sign-on: an OpenID Connect provider that signs people in with the authorization code flow.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | what the provider states about itself, the addresses of sign-in and sign-out, and the check of its
//! answer |
//! | [`settings`] | the section `[single_sign_on]` |
//! | [`fetch`] | HTTP requests to the provider, with limits |
//!
//! The service starts without the provider: what the provider states about itself is read in the background, and read
//! again from time to time, since its keys change.

pub mod fetch;
pub mod settings;

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use openidconnect::core::{
    CoreAuthenticationFlow, CoreClient, CoreClientAuthMethod, CoreIdToken, CoreJsonWebKey, CoreJwsSigningAlgorithm,
    CoreTokenResponse,
};
use openidconnect::{
    AccessToken, AccessTokenHash, AuthType, AuthorizationCode, ClaimsVerificationError, ClientId, ClientSecret,
    CsrfToken, DiscoveryError, EndpointMaybeSet, EndpointNotSet, EndpointSet, IdTokenVerifier, IssuerUrl,
    LogoutRequest, Nonce, OAuth2TokenResponse, PkceCodeChallenge, PkceCodeVerifier, PostLogoutRedirectUrl,
    ProviderMetadataWithLogout, RedirectUrl, RequestTokenError, Scope, SignatureVerificationError, TokenResponse,
};
use tokio::sync::Mutex;

use crate::domain::single_sign_on::{Claims, ProvenIdentity, groups_in};
use crate::shutdown::Shutdown;
use fetch::{FetchError, ProviderHttp};
use settings::{SingleSignOnSettings, is_allowed};

/// How often what the provider states about itself is read again.
const REFRESH_INTERVAL: Duration = Duration::from_secs(3600);
/// Time until the first repetition after a failure; it doubles with each further one.
const FIRST_RETRY: Duration = Duration::from_secs(2);
/// Longest time until a repetition.
const MAX_RETRY: Duration = Duration::from_secs(60);
/// Least time between two readings for tokens with an unknown key: a person must not make the service ask on and on.
const MIN_REFRESH_INTERVAL: Duration = Duration::from_secs(5);
/// Most bytes of a file with a secret.
const MAX_SECRET_BYTES: usize = 4096;
/// Longest subject, characters: OpenID Connect allows 255.
const MAX_SUBJECT: usize = 255;

/// The signatures that are accepted. None with a shared secret, and not `none`.
const SIGNATURES: [CoreJwsSigningAlgorithm; 9] = [
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha256,
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha384,
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha512,
    CoreJwsSigningAlgorithm::RsaSsaPssSha256,
    CoreJwsSigningAlgorithm::RsaSsaPssSha384,
    CoreJwsSigningAlgorithm::RsaSsaPssSha512,
    CoreJwsSigningAlgorithm::EcdsaP256Sha256,
    CoreJwsSigningAlgorithm::EcdsaP384Sha384,
    CoreJwsSigningAlgorithm::EdDsa,
];

/// A client of the provider whose addresses are known.
type KnownClient =
    CoreClient<EndpointSet, EndpointNotSet, EndpointNotSet, EndpointNotSet, EndpointMaybeSet, EndpointMaybeSet>;

/// The provider of single sign-on, and this service as its client.
pub struct IdentityProvider {
    settings: SingleSignOnSettings,
    issuer: IssuerUrl,
    client_id: ClientId,
    client_secret: Option<ClientSecret>,
    http: ProviderHttp,
    known: RwLock<Option<Arc<ProviderMetadataWithLogout>>>,
    /// When the last reading began. Locked while one is in progress.
    last_reading: Mutex<Option<Instant>>,
}

/// Why the settings cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ProviderSetupError {
    /// The file with the secret cannot be read.
    #[error("cannot read `{path}`, which single_sign_on.client_secret_file names: {source}")]
    Secret {
        /// Path of the file.
        path: PathBuf,
        /// What failed.
        source: io::Error,
    },
    /// The file with the secret is empty or far too long.
    #[error("`{0}`, which single_sign_on.client_secret_file names, must have one line with the secret")]
    NotASecret(PathBuf),
    /// The issuer is no address.
    #[error("single_sign_on.issuer: {0}")]
    Issuer(#[from] url::ParseError),
    /// The client cannot be made.
    #[error(transparent)]
    Http(#[from] FetchError),
}

/// Why the provider could not sign a person in.
#[derive(Debug, thiserror::Error)]
pub enum ProviderError {
    /// It does not answer, or what it states about itself cannot be used.
    #[error("the provider cannot be reached: {0}")]
    Unreachable(String),
    /// It does not accept the code, or this service as its client.
    #[error("the provider refused the code: {0}")]
    Refused(String),
    /// Its answer is not the proof that it must be.
    #[error("the provider's answer cannot be trusted: {0}")]
    Untrusted(String),
}

/// A sign-in that begins.
pub struct Authorization {
    /// The provider's address for the browser.
    pub address: String,
    /// What the answer is verified with.
    pub expected: ExpectedAnswer,
}

/// What the answer to a sign-in is verified with. One sign-in uses it, once.
pub struct ExpectedAnswer {
    redirect: RedirectUrl,
    nonce: Nonce,
    verifier: PkceCodeVerifier,
}

#[cfg(test)]
impl ExpectedAnswer {
    /// One that no answer fits.
    pub fn of_no_answer() -> Self {
        let redirect = RedirectUrl::new("https://skills.example/single-sign-on".to_owned());
        let verifier = PkceCodeVerifier::new("no answer fits".to_owned());
        Self { redirect: redirect.expect("an address"), nonce: Nonce::new_random(), verifier }
    }
}

/// A proven identity, with the token that proved it.
pub struct Proof {
    /// Who it is.
    pub identity: ProvenIdentity,
    /// The ID token, for the sign-out at the provider.
    pub id_token: String,
}

impl IdentityProvider {
    /// The provider of the settings; `None` if they name none.
    pub fn from_settings(settings: SingleSignOnSettings) -> Result<Option<Self>, ProviderSetupError> {
        let (Some(issuer), Some(client_id)) = (settings.issuer.clone(), settings.client_id.clone()) else {
            return Ok(None);
        };
        let client_secret = settings.client_secret_file.clone().map(read_secret).transpose()?;
        Ok(Some(Self {
            issuer: IssuerUrl::new(issuer)?,
            client_id: ClientId::new(client_id),
            client_secret,
            http: ProviderHttp::new()?,
            known: RwLock::new(None),
            last_reading: Mutex::new(None),
            settings,
        }))
    }

    /// The settings.
    pub fn settings(&self) -> &SingleSignOnSettings {
        &self.settings
    }

    /// Reads what the provider states about itself, now and again, until the service stops.
    pub async fn keep_known(&self, shutdown: &Shutdown) {
        let stop = shutdown.begun();
        tokio::pin!(stop);
        let mut retry = FIRST_RETRY;
        loop {
            let pause = match self.read_metadata(Duration::ZERO).await {
                Ok(()) => {
                    retry = FIRST_RETRY;
                    REFRESH_INTERVAL
                }
                Err(error) => {
                    let (issuer, retry_s) = (self.issuer.as_str(), retry.as_secs());
                    tracing::warn!(%error, issuer, retry_s, "provider of single sign-on not read; retrying");
                    let pause = retry;
                    retry = (retry * 2).min(MAX_RETRY);
                    pause
                }
            };
            tokio::select! {
                () = &mut stop => return,
                () = tokio::time::sleep(pause) => {}
            }
        }
    }

    /// Begins a sign-in whose answer comes to the address `redirect` of this service, with `state`.
    pub fn authorize(&self, redirect: String, state: String) -> Result<Authorization, ProviderError> {
        let redirect = RedirectUrl::new(redirect).map_err(|error| ProviderError::Unreachable(error.to_string()))?;
        let client = self.client(&redirect)?;
        let (challenge, verifier) = PkceCodeChallenge::new_random_sha256();
        let begin = client.authorize_url(
            CoreAuthenticationFlow::AuthorizationCode,
            move || CsrfToken::new(state),
            Nonce::new_random,
        );
        let further = self.settings.scopes.iter().filter(|scope| *scope != "openid").cloned();
        let begin = begin.add_scopes(further.map(Scope::new)).set_pkce_challenge(challenge);
        let (address, _, nonce) = begin.url();
        Ok(Authorization { address: address.into(), expected: ExpectedAnswer { redirect, nonce, verifier } })
    }

    /// Exchanges the code of a sign-in for a token, and verifies it: signature, issuer, audience, expiry and nonce.
    pub async fn prove(&self, code: String, expected: ExpectedAnswer) -> Result<Proof, ProviderError> {
        let ExpectedAnswer { redirect, nonce, verifier } = expected;
        let client = self.client(&redirect)?;
        let exchange = client.exchange_code(AuthorizationCode::new(code));
        let exchange = exchange.map_err(|error| ProviderError::Unreachable(error.to_string()))?;
        let answer =
            exchange.set_pkce_verifier(verifier).request_async(&self.http).await.map_err(|error| match error {
                RequestTokenError::ServerResponse(refused) => ProviderError::Refused(refused.to_string()),
                RequestTokenError::Request(error) => ProviderError::Unreachable(error.to_string()),
                other => ProviderError::Untrusted(other.to_string()),
            })?;
        let id_token = answer.id_token().ok_or_else(|| ProviderError::Untrusted("it has no ID token".to_owned()))?;
        let subject = match verify(&client, id_token, &nonce, &answer) {
            Err(error) if may_have_new_keys(&error) => {
                self.read_metadata(MIN_REFRESH_INTERVAL).await?;
                verify(&self.client(&redirect)?, id_token, &nonce, &answer)
            }
            verified => verified,
        };
        let subject = subject.map_err(|error| ProviderError::Untrusted(full(&error)))?;
        let id_token = id_token.to_string();
        let claims = claims_of(&id_token).ok_or_else(|| ProviderError::Untrusted("it has no claims".to_owned()))?;
        let claims = self.with_user_info(claims, &subject, answer.access_token()).await?;
        let groups = (self.settings.groups_claim.as_str(), &self.settings.roles);
        let issuer = self.issuer.as_str().to_owned();
        Ok(Proof { identity: ProvenIdentity::from_claims(issuer, subject, &claims, groups), id_token })
    }

    /// The address that ends the provider's own sign-in and comes back to the address `back`. `None` if the provider
    /// has none, or is not known yet.
    pub fn sign_out_address(&self, id_token: Option<&str>, back: String) -> Option<String> {
        let known = self.known()?;
        let end = known.additional_metadata().end_session_endpoint.clone()?;
        let request = LogoutRequest::from(end).set_client_id(self.client_id.clone());
        let request = request.set_post_logout_redirect_uri(PostLogoutRedirectUrl::new(back).ok()?);
        let hint: Option<CoreIdToken> = id_token.and_then(|token| token.parse().ok());
        let request = match &hint {
            Some(hint) => request.set_id_token_hint(hint),
            None => request,
        };
        Some(request.http_get_url().into())
    }

    /// The claims of the ID token, completed by those of the user info endpoint if the token has no groups.
    async fn with_user_info(
        &self,
        mut claims: Claims,
        subject: &str,
        access: &AccessToken,
    ) -> Result<Claims, ProviderError> {
        let endpoint = self.known().and_then(|known| known.userinfo_endpoint().cloned());
        let (None, Some(endpoint)) = (groups_in(&claims, &self.settings.groups_claim), endpoint) else {
            return Ok(claims);
        };
        let request = openidconnect::http::Request::get(endpoint.as_str())
            .header("authorization", format!("Bearer {}", access.secret()))
            .header("accept", "application/json");
        let request = request.body(Vec::new()).map_err(|error| ProviderError::Untrusted(error.to_string()))?;
        let answer = self.http.send(request).await.map_err(|error| ProviderError::Unreachable(error.to_string()))?;
        if !answer.status().is_success() {
            return Err(ProviderError::Refused(format!("the user info endpoint answered {}", answer.status())));
        }
        let more: Claims = serde_json::from_slice(answer.body())
            .map_err(|error| ProviderError::Untrusted(format!("the user info is not JSON: {error}")))?;
        if more.get("sub").and_then(|sub| sub.as_str()) != Some(subject) {
            return Err(ProviderError::Untrusted("the user info is of another account".to_owned()));
        }
        for (name, value) in more {
            claims.entry(name).or_insert(value); // what the signed token says stays
        }
        Ok(claims)
    }

    fn known(&self) -> Option<Arc<ProviderMetadataWithLogout>> {
        self.known.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// A client with what is known of the provider.
    fn client(&self, redirect: &RedirectUrl) -> Result<KnownClient, ProviderError> {
        let unknown = || ProviderError::Unreachable("it has not been read yet".to_owned());
        let known = self.known().ok_or_else(unknown)?;
        let in_body = known.token_endpoint_auth_methods_supported().is_some_and(|methods| {
            let has = |method| methods.contains(&method);
            has(CoreClientAuthMethod::ClientSecretPost) && !has(CoreClientAuthMethod::ClientSecretBasic)
        });
        let (id, secret) = (self.client_id.clone(), self.client_secret.clone());
        let client = CoreClient::from_provider_metadata((*known).clone(), id, secret);
        let auth_type = if in_body { AuthType::RequestBody } else { AuthType::BasicAuth };
        Ok(client.set_auth_type(auth_type).set_redirect_uri(redirect.clone()))
    }

    /// Reads what the provider states about itself, with its keys, unless it was read less than `least` ago.
    async fn read_metadata(&self, least: Duration) -> Result<(), ProviderError> {
        let mut last_reading = self.last_reading.lock().await;
        if last_reading.is_some_and(|at| at.elapsed() < least) {
            return Ok(());
        }
        *last_reading = Some(Instant::now());
        let read = ProviderMetadataWithLogout::discover_async(self.issuer.clone(), &self.http).await;
        let read = read.map_err(|error: DiscoveryError<FetchError>| ProviderError::Unreachable(full(&error)))?;
        let end = read.additional_metadata().end_session_endpoint.as_ref();
        let of_browsers = [Some(read.authorization_endpoint().url()), end.map(|end| end.url())];
        if let Some(wrong) = of_browsers.into_iter().flatten().find(|url| !is_allowed(url)) {
            return Err(ProviderError::Unreachable(format!("it names the address `{wrong}`, which is not https")));
        }
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        if known.replace(Arc::new(read)).is_none() {
            tracing::info!(issuer = self.issuer.as_str(), "provider of single sign-on read");
        }
        Ok(())
    }
}

/// Verifies the token, and returns its subject.
fn verify(
    client: &KnownClient,
    token: &CoreIdToken,
    nonce: &Nonce,
    answer: &CoreTokenResponse,
) -> Result<String, ClaimsVerificationError> {
    let verifier: IdTokenVerifier<'_, CoreJsonWebKey> = client.id_token_verifier().set_allowed_algs(SIGNATURES);
    let claims = token.claims(&verifier, nonce)?;
    if let Some(stated) = claims.access_token_hash() {
        let (alg, key) = (token.signing_alg(), token.signing_key(&verifier));
        let (alg, key) = alg.and_then(|alg| Ok((alg, key?))).map_err(ClaimsVerificationError::SignatureVerification)?;
        let actual = AccessTokenHash::from_token(answer.access_token(), alg, key);
        if actual.ok().as_ref() != Some(stated) {
            return Err(ClaimsVerificationError::Other("the access token is not the one of the ID token".to_owned()));
        }
    }
    let subject = claims.subject().as_str();
    if subject.is_empty() || subject.chars().count() > MAX_SUBJECT {
        return Err(ClaimsVerificationError::InvalidSubject(format!("expected 1 to {MAX_SUBJECT} characters")));
    }
    Ok(subject.to_owned())
}

/// True if other keys of the provider could verify the token: it may have changed them since they were read.
fn may_have_new_keys(error: &ClaimsVerificationError) -> bool {
    use SignatureVerificationError::{AmbiguousKeyId, CryptoError, NoMatchingKey};
    matches!(error, ClaimsVerificationError::SignatureVerification(NoMatchingKey | CryptoError(_) | AmbiguousKeyId(_)))
}

/// The claims of a token that has been verified.
fn claims_of(verified: &str) -> Option<Claims> {
    let payload = URL_SAFE_NO_PAD.decode(verified.split('.').nth(1)?).ok()?;
    serde_json::from_slice(&payload).ok()
}

fn read_secret(path: PathBuf) -> Result<ClientSecret, ProviderSetupError> {
    let read = std::fs::read_to_string(&path);
    let text = read.map_err(|source| ProviderSetupError::Secret { path: path.clone(), source })?;
    let secret = text.trim();
    if secret.is_empty() || secret.len() > MAX_SECRET_BYTES || secret.contains(char::is_whitespace) {
        return Err(ProviderSetupError::NotASecret(path));
    }
    Ok(ClientSecret::new(secret.to_owned()))
}

/// The error with its causes, since the errors of the library name only the step.
fn full(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |error| error.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}
