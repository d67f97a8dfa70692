//! A small OpenID Connect provider on port 0, whose answers a test chooses: right ones and hostile ones.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Form, Json, Router};
use base64::Engine;
use base64::engine::general_purpose::{STANDARD, URL_SAFE_NO_PAD};
use ring::signature::{Ed25519KeyPair, KeyPair};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::net::TcpListener;
use trocar::time::{Clock, SystemClock};

pub const CLIENT: (&str, &str) = ("trocar", "a-secret-of-tests");

/// What is wrong with an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fault {
    #[default]
    None,
    Audience,
    Issuer,
    Nonce,
    Expired,
    /// Signed with a key that the provider does not have.
    Key,
    /// `alg` is `none`.
    Unsigned,
    /// `alg` is `HS256`, with the client's secret.
    SharedSecret,
    /// Another access token than the one that the ID token names.
    AccessToken,
    NoIdToken,
    /// Two MiB.
    Huge,
    Redirect,
    NotJson,
    /// The groups are in the user info, of another account.
    UserInfoOfOther,
    /// The code is not accepted.
    Refused,
}

#[derive(Default)]
struct Wanted {
    fault: Fault,
    claims: Value,
    /// Only in the user info.
    user_info: Value,
    /// Number of the key.
    key: u8,
    nonce: String,
    challenge: String,
    redirect: String,
}

/// The provider. It ends with the test's runtime.
#[derive(Clone)]
pub struct Provider {
    pub address: SocketAddr,
    wanted: Arc<Mutex<Wanted>>,
}

impl Provider {
    pub async fn start() -> Self {
        Self::start_at(TcpListener::bind("127.0.0.1:0").await.unwrap())
    }

    pub fn start_at(listener: TcpListener) -> Self {
        let provider = Self { address: listener.local_addr().unwrap(), wanted: Arc::default() };
        let routes = Router::new()
            .route("/.well-known/openid-configuration", get(configuration))
            .route("/keys", get(keys))
            .route("/token", post(token))
            .route("/user-info", get(user_info))
            .with_state(provider.clone());
        tokio::spawn(async move { axum::serve(listener, routes).await });
        provider
    }

    pub fn issuer(&self) -> String {
        format!("http://{}", self.address)
    }

    /// The account that signs in from now on.
    pub fn sign_in_as(&self, subject: &str, groups: &[&str]) {
        let claims = json!({"sub": subject, "name": format!("Name of {subject}"), "preferred_username": subject,
                            "email": format!("{subject}@id.example"), "groups": groups});
        let mut wanted = self.wanted.lock().unwrap();
        wanted.claims = claims;
        wanted.user_info = json!({});
    }

    /// The groups stand in the user info only.
    pub fn move_groups_to_user_info(&self) {
        let mut wanted = self.wanted.lock().unwrap();
        let groups = wanted.claims.as_object_mut().unwrap().remove("groups").unwrap();
        wanted.user_info = json!({"sub": wanted.claims["sub"], "groups": groups});
    }

    pub fn fail(&self, fault: Fault) {
        self.wanted.lock().unwrap().fault = fault;
    }

    /// The provider signs with another key from now on, and forgets the old one.
    pub fn change_key(&self) {
        self.wanted.lock().unwrap().key += 1;
    }

    /// Does what the provider does when a person signs in at this address. Returns `state`.
    pub fn visit(&self, address: &str) -> String {
        let address: reqwest::Url = address.parse().unwrap();
        assert!(address.as_str().starts_with(&format!("{}/authorize?", self.issuer())), "{address}");
        let query: HashMap<String, String> = address.query_pairs().into_owned().collect();
        assert_eq!((query["response_type"].as_str(), query["client_id"].as_str()), ("code", CLIENT.0));
        assert_eq!(query["code_challenge_method"], "S256");
        assert!(query["scope"].split(' ').any(|scope| scope == "openid"));
        let mut wanted = self.wanted.lock().unwrap();
        wanted.nonce = query["nonce"].clone();
        wanted.challenge = query["code_challenge"].clone();
        wanted.redirect = query["redirect_uri"].clone();
        query["state"].clone()
    }

    /// The address that the provider sends the browser back to.
    pub fn redirect(&self) -> String {
        self.wanted.lock().unwrap().redirect.clone()
    }
}

fn key_pair(number: u8) -> Ed25519KeyPair {
    Ed25519KeyPair::from_seed_unchecked(&[number; 32]).unwrap()
}

async fn configuration(State(provider): State<Provider>) -> Json<Value> {
    let at = |path: &str| format!("{}/{path}", provider.issuer());
    Json(json!({
        "issuer": provider.issuer(), "authorization_endpoint": at("authorize"), "token_endpoint": at("token"),
        "jwks_uri": at("keys"), "userinfo_endpoint": at("user-info"), "end_session_endpoint": at("end"),
        "response_types_supported": ["code"], "subject_types_supported": ["public"],
        "id_token_signing_alg_values_supported": ["EdDSA", "none", "HS256"],
    }))
}

async fn keys(State(provider): State<Provider>) -> Json<Value> {
    let number = provider.wanted.lock().unwrap().key;
    let public = URL_SAFE_NO_PAD.encode(key_pair(number).public_key());
    let key =
        json!({"kty": "OKP", "crv": "Ed25519", "use": "sig", "alg": "EdDSA", "kid": number.to_string(), "x": public});
    Json(json!({"keys": [key]}))
}

async fn user_info(State(provider): State<Provider>, headers: HeaderMap) -> Json<Value> {
    assert_eq!(headers[header::AUTHORIZATION], "Bearer an-access-token");
    let wanted = provider.wanted.lock().unwrap();
    let mut claims = wanted.user_info.clone();
    if wanted.fault == Fault::UserInfoOfOther {
        claims["sub"] = json!("another");
    }
    Json(claims)
}

async fn token(
    State(provider): State<Provider>,
    headers: HeaderMap,
    Form(form): Form<HashMap<String, String>>,
) -> Response {
    let basic = format!("Basic {}", STANDARD.encode(format!("{}:{}", CLIENT.0, CLIENT.1)));
    assert_eq!(headers[header::AUTHORIZATION].to_str().unwrap(), basic);
    let wanted = provider.wanted.lock().unwrap();
    let challenge = URL_SAFE_NO_PAD.encode(Sha256::digest(&form["code_verifier"]));
    assert_eq!((challenge.as_str(), &form["redirect_uri"]), (wanted.challenge.as_str(), &wanted.redirect));
    assert_eq!((form["grant_type"].as_str(), form["code"].as_str()), ("authorization_code", "a-code"));
    let mut answer = json!({"access_token": "an-access-token", "token_type": "Bearer", "expires_in": 60,
                            "id_token": id_token(&provider.issuer(), &wanted)});
    match wanted.fault {
        Fault::Huge => answer["padding"] = json!("x".repeat(2 << 20)),
        Fault::NoIdToken => drop(answer.as_object_mut().unwrap().remove("id_token")),
        Fault::Redirect => return (StatusCode::FOUND, [(header::LOCATION, "/token")]).into_response(),
        Fault::NotJson => return "<html>".into_response(),
        Fault::Refused => return (StatusCode::BAD_REQUEST, Json(json!({"error": "invalid_grant"}))).into_response(),
        _ => {}
    }
    Json(answer).into_response()
}

fn id_token(issuer: &str, wanted: &Wanted) -> String {
    let now_s = SystemClock.now_ms() / 1000;
    let access_token = if wanted.fault == Fault::AccessToken { "another" } else { "an-access-token" };
    let access_hash = URL_SAFE_NO_PAD.encode(&sha2::Sha512::digest(access_token)[..32]);
    let mut claims = wanted.claims.clone();
    claims["iss"] = json!(if wanted.fault == Fault::Issuer { "http://127.0.0.1:1" } else { issuer });
    claims["aud"] = json!(if wanted.fault == Fault::Audience { "another-service" } else { CLIENT.0 });
    claims["nonce"] = json!(if wanted.fault == Fault::Nonce { "another" } else { &wanted.nonce });
    claims["exp"] = json!(if wanted.fault == Fault::Expired { now_s - 60 } else { now_s + 60 });
    claims["iat"] = json!(now_s - 120);
    claims["at_hash"] = json!(access_hash);
    let alg = match wanted.fault {
        Fault::Unsigned => "none",
        Fault::SharedSecret => "HS256",
        _ => "EdDSA",
    };
    let head = json!({"alg": alg, "kid": wanted.key.to_string(), "typ": "JWT"});
    let encode = |part: &Value| URL_SAFE_NO_PAD.encode(part.to_string());
    let signed = format!("{}.{}", encode(&head), encode(&claims));
    let signature = match wanted.fault {
        Fault::Unsigned => Vec::new(),
        Fault::SharedSecret => {
            let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, CLIENT.1.as_bytes());
            ring::hmac::sign(&key, signed.as_bytes()).as_ref().to_vec()
        }
        Fault::Key => key_pair(200).sign(signed.as_bytes()).as_ref().to_vec(),
        _ => key_pair(wanted.key).sign(signed.as_bytes()).as_ref().to_vec(),
    };
    format!("{signed}.{}", URL_SAFE_NO_PAD.encode(signature))
}
