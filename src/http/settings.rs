//! Limits of the HTTP side, each with its unit, what more and less of it do, and its usual value.

use std::time::Duration;

use serde::Deserialize;

/// What `[http]` in the settings file may hold.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HttpSettings {
    /// Connections open at once. More take memory (about 20 kB each when idle); the next one waits until one closes.
    pub max_connections: usize,
    /// Seconds in which a request's head must have come, also the longest idle time of a kept connection. Less frees
    /// places sooner; more meets fewer clients that send into a connection which is just closing.
    pub head_timeout_s: f64,
    /// Slowest body that is read, bytes per second, measured while we wait for the client.
    pub min_body_rate: u64,
    /// Seconds that a body may stall before [`Self::min_body_rate`] ends it.
    pub body_grace_s: f64,
    /// Seconds without the client reading one byte of an answer, after which its connection is closed.
    pub write_timeout_s: f64,
    /// Largest JSON body, bytes.
    pub max_json_bytes: usize,
    /// Largest multipart body (photos, annotations with a clip), bytes.
    pub max_form_bytes: u64,
    /// Minutes without a request after which a sign-in ends.
    pub idle_min: u64,
    /// Hours after which a sign-in ends in any case.
    pub sign_in_h: u64,
    /// Sign-in attempts that one login may make from one address in a minute.
    pub attempts_per_min: u32,
    /// Event streams and live conversations open at once.
    pub max_event_streams: usize,
    /// Those of one person, half of all at most: a wall of boxes takes one for each box that sends.
    pub max_event_streams_of_one: usize,
    /// Address under which the service is known, such as `https://skills.example`: what xAPI names accounts and tasks by. Without it,
    /// as the request names it: then the same person has as many accounts as the service has addresses.
    pub public_url: Option<String>,
    /// Items of a list's page when the request names no limit.
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
            attempts_per_min: 5,
            max_event_streams: 256,
            max_event_streams_of_one: 96,
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

    /// [`Self::body_grace_s`].
    pub fn body_grace(&self) -> Duration {
        seconds(self.body_grace_s)
    }

    /// [`Self::write_timeout_s`].
    pub fn write_timeout(&self) -> Duration {
        seconds(self.write_timeout_s)
    }
}

/// A duration from settings; nonsense becomes one day, which is as good as "no limit" and as safe as a number.
fn seconds(value: f64) -> Duration {
    Duration::try_from_secs_f64(value).unwrap_or(Duration::from_secs(86_400))
}
