//! Limits of the HTTP server, each with its unit, the effect of larger and smaller values, and its default.

use std::net::IpAddr;
use std::time::Duration;

use ipnet::IpNet;
use serde::de::Error;
use serde::{Deserialize, Deserializer};

use super::base_path::BasePath;
use super::client_address::ClientAddressHeader;

/// The section `[http]` of the settings file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HttpSettings {
    /// Most connections open at once. More need memory (about 20 kB each when idle). A further one takes the place of
    /// one that serves no request of a caller who has signed in, or waits until there is one.
    pub max_connections: usize,
    /// Seconds until a request's head must have arrived; also the longest idle time of a keep-alive connection.
    /// A smaller value frees connections sooner; with a larger one, fewer clients send into a connection that
    /// is just closing.
    pub head_timeout_s: f64,
    /// Minimum rate of a body, bytes per second, measured while the service waits for the client.
    pub min_body_rate: u64,
    /// Seconds that a body may stall before it is ended for violating [`Self::min_body_rate`].
    pub body_grace_s: f64,
    /// Seconds after which a connection is closed if the client reads no byte of the answer.
    pub write_timeout_s: f64,
    /// Largest JSON body, bytes. Requests without a sign-in have at most 4 KiB.
    pub max_json_bytes: usize,
    /// Largest multipart body (photos, annotations with a clip), bytes.
    pub max_form_bytes: u64,
    /// Minutes without a request after which a sign-in ends.
    pub idle_min: u64,
    /// Hours after which a sign-in ends in any case.
    pub sign_in_h: u64,
    /// Hours after which a link for a password expires.
    pub password_link_h: u64,
    /// Days after which a link for the first password of an invited trainee expires. Printed slips need longer than a
    /// link that is used at once.
    pub invitation_days: u64,
    /// Failed sign-ins of a login before the next attempt has to wait. One network address may fail twelve times as
    /// often a minute.
    #[serde(alias = "attempts_per_min")]
    pub free_attempts: u32,
    /// Addresses or networks of the proxies in front of the service, such as `127.0.0.1` or `192.0.2.0/28`. Only they
    /// may state a client's address, so no client may lie in such a network. Without any, all users behind a proxy
    /// count as one address.
    #[serde(deserialize_with = "networks")]
    pub trusted_proxies: Vec<IpNet>,
    /// The header that these proxies set: `x-forwarded-for` or `forwarded`.
    pub client_address_header: ClientAddressHeader,
    /// Days that a browser which has reached the service over HTTPS uses nothing else for the same host name, on any
    /// port (HSTS). 0 ends this for browsers that come again. Without effect over plain HTTP.
    pub hsts_days: u32,
    /// Most event streams and live views open at once. A browser that shows *Live* needs one, and another for each
    /// recording that arrives; each takes about 30 KiB.
    pub max_event_streams: usize,
    /// Most of them for one user, at most half of all: a display of all boxes needs one for each box that sends.
    pub max_event_streams_of_one: usize,
    /// Most large answers (paths, diagnostics, tables of features) in progress at once. Each takes up to 8 MiB; with
    /// fewer, people wait longer for each other.
    pub max_heavy_answers: usize,
    /// Most of them for one user. A page loads two at a time.
    pub max_heavy_answers_of_one: usize,
    /// Seconds that a request waits for others of them to end. Longer waits hold connections; after shorter ones, more
    /// requests are refused.
    pub heavy_answer_wait_s: f64,
    /// Path that the service lies under, such as `/trocar` behind a proxy for `https://skills.example/trocar/`. The
    /// proxy passes it on unchanged. By default the service has the host for itself.
    pub base_path: BasePath,
    /// Public address of the service, such as `https://skills.example`, with [`Self::base_path`] if there is one; xAPI
    /// statements identify accounts and tasks by it, and the provider of single sign-on sends browsers back to it. By
    /// default the address in the request is used: then a person has a separate xAPI account for each address of the
    /// service.
    pub public_url: Option<String>,
    /// Items on a page of a list if the request names no limit.
    pub page_items: u32,
}

impl Default for HttpSettings {
    fn default() -> Self {
        Self {
            max_connections: 2048,
            head_timeout_s: 30.0,
            min_body_rate: 1024,
            body_grace_s: 20.0,
            write_timeout_s: 60.0,
            max_json_bytes: 256 * 1024,
            max_form_bytes: 2 * 1024 * 1024 * 1024,
            idle_min: 30,
            sign_in_h: 12,
            password_link_h: 24,
            invitation_days: 14,
            free_attempts: 5,
            trusted_proxies: Vec::new(),
            client_address_header: ClientAddressHeader::default(),
            hsts_days: 365,
            max_event_streams: 1024,
            max_event_streams_of_one: 96,
            max_heavy_answers: 16,
            max_heavy_answers_of_one: 2,
            heavy_answer_wait_s: 20.0,
            base_path: BasePath::default(),
            public_url: None,
            page_items: 50,
        }
    }
}

impl HttpSettings {
    /// [`Self::head_timeout_s`].
    pub fn head_timeout(&self) -> Duration {
        seconds(self.head_timeout_s)
    }

    /// [`Self::idle_min`].
    pub fn idle(&self) -> Duration {
        Duration::from_secs(self.idle_min.saturating_mul(60))
    }

    /// [`Self::sign_in_h`].
    pub fn sign_in(&self) -> Duration {
        Duration::from_secs(self.sign_in_h.saturating_mul(3600))
    }

    /// [`Self::password_link_h`].
    pub fn password_link(&self) -> Duration {
        Duration::from_secs(self.password_link_h.saturating_mul(3600))
    }

    /// [`Self::invitation_days`].
    pub fn invitation(&self) -> Duration {
        Duration::from_secs(self.invitation_days.saturating_mul(24 * 3600))
    }

    /// [`Self::body_grace_s`].
    pub fn body_grace(&self) -> Duration {
        seconds(self.body_grace_s)
    }

    /// [`Self::heavy_answer_wait_s`].
    pub fn heavy_answer_wait(&self) -> Duration {
        seconds(self.heavy_answer_wait_s)
    }

    /// [`Self::write_timeout_s`].
    pub fn write_timeout(&self) -> Duration {
        seconds(self.write_timeout_s)
    }
}

/// Networks, each as an address or with the length of its prefix.
fn networks<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<IpNet>, D::Error> {
    let network = |text: String| {
        let of_address = text.parse::<IpAddr>().map(|address| IpNet::from(address.to_canonical()));
        of_address.or_else(|_| text.parse()).map_err(|_| {
            D::Error::custom(format!(
                "`{text}` is no address or network; expected one such as 127.0.0.1 or 192.0.2.0/28"
            ))
        })
    };
    Vec::<String>::deserialize(from)?.into_iter().map(network).collect()
}

/// A duration from settings. An invalid value becomes one day: practically no limit, but a safe number.
fn seconds(value: f64) -> Duration {
    Duration::try_from_secs_f64(value).unwrap_or(Duration::from_secs(86_400))
}
