//! Where the service lives, for what leaves it and must be found again: xAPI names accounts and activities by addresses.

use axum::http::uri::Authority;
use axum::http::{HeaderMap, header};

use super::state::App;

impl App {
    /// The service's address, without a slash at its end: as it is set, else as the request names it.
    pub fn home(&self, headers: &HeaderMap) -> String {
        if let Some(set) = &self.settings.public_url {
            return set.trim_end_matches('/').to_owned();
        }
        let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
        let host = host.and_then(|host| host.parse::<Authority>().ok());
        format!("http://{}", host.as_ref().map_or("localhost", Authority::as_str))
    }
}
