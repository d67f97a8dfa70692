//! The service's public address. xAPI statements identify accounts and activities by addresses that start with it, and
//! certificates, codes for a check-in and the provider of single sign-on have addresses of its pages.

use std::net::IpAddr;

use axum::http::uri::Authority;
use axum::http::{HeaderMap, Uri, header};

use super::error::{HandlerResult, Refusal};
use super::state::App;

/// Who can open an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum AddressReach {
    /// It has a name or number of the internet.
    Internet,
    /// Only computers in the same network.
    Network,
    /// Only the computer of the service.
    Computer,
}

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

    /// The service's address for what lasts and is read elsewhere, such as a certificate: as [`App::base_url`]. Check first
    /// whether the caller may make it.
    ///
    /// # Errors
    /// The address, which is set or that of the request, can be opened only here; unless `is_local_accepted`.
    pub fn lasting_base_url(&self, headers: &HeaderMap, is_local_accepted: bool) -> HandlerResult<String> {
        let base = self.base_url(headers);
        let Some(readers) = local_readers(&base).filter(|_| !is_local_accepted) else { return Ok(base) };
        let detail = format!(
            "It would have the address {base} for ever, which can be opened {readers}. An administrator can set the right \
             address: `public_url` under `[http]` in the settings file, which is trocar.toml in the data folder unless the \
             service was started with another one. It counts after a restart. If it is to have this address all the same, \
             confirm it with `accept_local_address`."
        );
        Err(Refusal::Conflict.with(detail).member("local_address", base))
    }
}

/// True if only the computer of the service can open an address.
pub fn is_of_this_computer(address: &str) -> bool {
    reach_of_address(address) == AddressReach::Computer
}

/// Where an address can be opened, in words; `None` if it has a name or number of the internet.
pub fn local_readers(address: &str) -> Option<&'static str> {
    match reach_of_address(address) {
        AddressReach::Computer => Some("only on this computer"),
        AddressReach::Network => Some("only in your own network"),
        AddressReach::Internet => None,
    }
}

fn reach_of_address(address: &str) -> AddressReach {
    let address: Option<Uri> = address.parse().ok();
    reach_of(address.as_ref().and_then(Uri::host).unwrap_or("localhost"))
}

/// Who can open an address with this host.
fn reach_of(host: &str) -> AddressReach {
    let host = host.trim_start_matches('[').trim_end_matches(']').trim_end_matches('.').to_ascii_lowercase();
    if let Ok(address) = host.parse::<IpAddr>() {
        return match address.to_canonical() {
            address if address.is_loopback() || address.is_unspecified() => AddressReach::Computer,
            IpAddr::V4(v4) if v4.is_private() || v4.is_link_local() => AddressReach::Network,
            IpAddr::V6(v6) if v6.is_unique_local() || v6.is_unicast_link_local() => AddressReach::Network,
            _ => AddressReach::Internet,
        };
    }
    let local_endings = [".local", ".lan", ".internal", ".intranet", ".home.arpa", ".localdomain", ".test"];
    match &*host {
        "localhost" => AddressReach::Computer,
        name if name.ends_with(".localhost") => AddressReach::Computer,
        name if !name.contains('.') || local_endings.iter().any(|ending| name.ends_with(ending)) => {
            AddressReach::Network
        }
        _ => AddressReach::Internet,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reach_of_an_address_follows_from_its_host() {
        for host in ["localhost", "LOCALHOST", "trocar.localhost", "127.0.0.1", "127.8.8.8", "[::1]", "0.0.0.0"] {
            assert_eq!(reach_of(host), AddressReach::Computer, "{host}");
        }
        for host in [
            "192.168.1.5",
            "10.0.0.1",
            "172.16.0.9",
            "169.254.1.1",
            "[fd00::1]",
            "[fe80::1]",
            "trocar",
            "skills.local",
            "skills.lan",
            "::ffff:10.0.0.1",
        ] {
            assert_eq!(reach_of(host), AddressReach::Network, "{host}");
        }
        for host in ["skills.example", "203.0.113.9", "172.32.0.1", "[2001:db8::1]", "skills.hospital.example."] {
            assert_eq!(reach_of(host), AddressReach::Internet, "{host}");
        }
    }
    #[test]
    fn an_address_that_can_be_opened_only_here_is_recognised() {
        for (address, readers) in [
            ("https://skills.example/trocar", None),
            ("http://localhost:8080", Some("only on this computer")),
            ("http://[::1]:8080/trocar", Some("only on this computer")),
            ("https://192.168.1.5", Some("only in your own network")),
            ("https://skills", Some("only in your own network")),
        ] {
            assert_eq!(local_readers(address), readers, "{address}");
        }
    }
}
