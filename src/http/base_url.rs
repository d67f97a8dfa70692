//! The service's public address. xAPI statements identify accounts and activities by addresses that start with it.

use axum::http::uri::Authority;
use axum::http::{HeaderMap, header};

use super::state::App;

impl App {
    /// The service's address without a trailing slash: `public_url` if it is set, else the `Host` of the request with
    /// the path that the service lies under.
    pub fn base_url(&self, headers: &HeaderMap) -> String {
        if let Some(set) = &self.settings.public_url {
            return set.trim_end_matches('/').to_owned();
        }
        let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
        let host = host.and_then(|host| host.parse::<Authority>().ok());
        let scheme = if self.service_info.is_https { "https" } else { "http" };
        format!("{scheme}://{}{}", host.as_ref().map_or("localhost", Authority::as_str), self.settings.base_path)
    }
}
