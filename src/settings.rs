//! Settings, typed and checked: defaults ← file ← environment ← flags; the later source wins. Every limit has a name,
//! here or in the module that it limits.
//!
//! The file is TOML. It is `trocar.toml` in the data folder, or the file that `--settings` or `TROCAR_SETTINGS` names.
//! A variable `TROCAR_<KEY>` or `TROCAR_<SECTION>__<KEY>` sets one value (`TROCAR_QUEUE__LEASE_S=60`). An unknown key
//! is an error that names the key: otherwise a misspelt limit would leave the default in force unnoticed.
//!
//! ```toml
//! listen = "127.0.0.1:8080"
//! workers = 2
//!
//! [queue]
//! lease_s = 30
//! ```

use std::fmt::Display;
use std::net::SocketAddr;
use std::ops::RangeInclusive;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use toml::{Table, Value};

use crate::analysis::AnalysisSettings;
use crate::domain::rights::RightsSettings;
use crate::http::settings::HttpSettings;
use crate::http::tls::TlsSettings;
use crate::identity_provider::settings::SingleSignOnSettings;
use crate::intake::UploadSettings;
use crate::intake::inbox::InboxSettings;
use crate::live::LiveSettings;
use crate::queue::QueueSettings;
use crate::rescoring::RescoringSettings;
use crate::store::StoreSettings;
use crate::upkeep::{BackupSettings, RetentionSettings};

/// All settings of the service.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Folder for database, recordings and results. The first start creates it.
    pub data: PathBuf,
    /// Address to listen on. With a loopback address, other machines cannot reach the service.
    pub listen: SocketAddr,
    /// How many recordings are tracked at the same time. Each takes a core or more while it decodes. 0: half the cores.
    pub workers: usize,
    /// The database.
    pub store: StoreSettings,
    /// The queue.
    pub queue: QueueSettings,
    /// Connections, requests and sign-ins.
    pub http: HttpSettings,
    /// What instructors may do beyond their own groups.
    pub rights: RightsSettings,
    /// Single sign-on with an OpenID Connect provider.
    pub single_sign_on: SingleSignOnSettings,
    /// Certificate and key for HTTPS.
    pub tls: TlsSettings,
    /// Child processes that decode and track.
    pub analysis: AnalysisSettings,
    /// Uploads of recordings.
    pub uploads: UploadSettings,
    /// The watched folder of the server.
    pub inbox: InboxSettings,
    /// Live feeds: recordings that arrive frame by frame.
    pub live: LiveSettings,
    /// Rescoring of sessions.
    pub rescoring: RescoringSettings,
    /// Removal of files that are no longer needed.
    pub upkeep: UpkeepSettings,
    /// Scheduled backups.
    pub backup: BackupSettings,
    /// How long videos and erased people are kept.
    pub retention: RetentionSettings,
}

/// Settings of upkeep.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UpkeepSettings {
    /// Interval between removals of unreferenced files and expired uploads, s. Limits how long an erased recording
    /// stays on the disk. Default 20.
    pub collect_s: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            data: PathBuf::from("trocar-data"),
            listen: SocketAddr::from(([127, 0, 0, 1], 8080)),
            workers: 0,
            store: StoreSettings::default(),
            queue: QueueSettings::default(),
            http: HttpSettings::default(),
            rights: RightsSettings::default(),
            single_sign_on: SingleSignOnSettings::default(),
            tls: TlsSettings::default(),
            analysis: AnalysisSettings::default(),
            uploads: UploadSettings::default(),
            inbox: InboxSettings::default(),
            live: LiveSettings::default(),
            rescoring: RescoringSettings::default(),
            upkeep: UpkeepSettings::default(),
            backup: BackupSettings::default(),
            retention: RetentionSettings::default(),
        }
    }
}

impl Default for UpkeepSettings {
    fn default() -> Self {
        Self { collect_s: 20 }
    }
}

/// Settings given on the command line. They win over all other sources.
#[derive(Clone, Debug, Default)]
pub struct Flags {
    /// The settings file.
    pub settings: Option<PathBuf>,
    /// [`Settings::data`].
    pub data: Option<PathBuf>,
    /// [`Settings::listen`].
    pub listen: Option<SocketAddr>,
    /// [`Settings::workers`].
    pub workers: Option<usize>,
    /// The folder of [`Settings::inbox`].
    pub inbox: Option<PathBuf>,
}

/// Why the settings cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The named file cannot be read.
    #[error("cannot read the settings file `{path}`: {source}")]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is not TOML, or has an unknown key or a value of the wrong type.
    #[error("settings file `{path}`: {why}")]
    File {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong, and where.
        why: String,
    },
    /// An environment variable names an unknown key, or has a value of the wrong type.
    #[error("environment variable {name}: {why}")]
    Variable {
        /// Name of the variable.
        name: String,
        /// What is wrong.
        why: String,
    },
    /// A value outside its range, or one that contradicts another.
    #[error("setting `{key}` is {value}; expected {expected}")]
    Value {
        /// The key.
        key: &'static str,
        /// Its value.
        value: String,
        /// What it should be.
        expected: &'static str,
    },
}

/// File name of the database in the data folder.
pub const DATABASE_FILE: &str = "trocar.db";

/// Variables with our prefix that are not settings: they choose the settings file, stand for flags of `serve`, or belong
/// to tests.
const OTHER_VARIABLES: [&str; 8] = [
    "TROCAR_SETTINGS",
    "TROCAR_LOG",
    "TROCAR_HIDE_PASSWORD",
    "TROCAR_SHARED",
    "TROCAR_TEST",
    "TROCAR_GOLDEN",
    "TROCAR_SKIPS",
    "TROCAR_MUST_NOT_SKIP",
];
const PREFIX: &str = "TROCAR_";

impl Settings {
    /// Reads the settings from the file, the environment of this process, and `flags`.
    pub fn load(flags: Flags) -> Result<Self, SettingsError> {
        let variables: Vec<(String, String)> = std::env::vars().filter(|(name, _)| name.starts_with(PREFIX)).collect();
        Self::from_parts(flags, &variables)
    }

    /// Like [`Settings::load`], with these environment variables.
    fn from_parts(flags: Flags, variables: &[(String, String)]) -> Result<Self, SettingsError> {
        let variable = |wanted: &str| variables.iter().find(|(name, _)| name == wanted).map(|(_, value)| value);
        let named = flags.settings.clone().or_else(|| variable("TROCAR_SETTINGS").map(PathBuf::from));
        let data = flags.data.clone().or_else(|| variable("TROCAR_DATA").map(PathBuf::from));
        let mut table = match (named, data.unwrap_or_else(|| Settings::default().data).join("trocar.toml")) {
            (Some(path), _) => read(&path)?,
            (None, usual) if usual.exists() => read(&usual)?,
            (None, _) => Table::new(),
        };
        for (name, value) in variables.iter().filter(|(name, _)| !OTHER_VARIABLES.contains(&name.as_str())) {
            set_from_variable(&mut table, name, value)?;
        }
        let mut settings: Settings = parse(table).map_err(|why| SettingsError::Value {
            key: "environment",
            value: why,
            expected: "values that fit together",
        })?;
        settings.data = flags.data.unwrap_or(settings.data);
        settings.listen = flags.listen.unwrap_or(settings.listen);
        settings.workers = flags.workers.unwrap_or(settings.workers);
        settings.inbox.folder = flags.inbox.or(settings.inbox.folder);
        settings.check()?;
        Ok(settings)
    }

    /// Path of the database.
    pub fn database(&self) -> PathBuf {
        self.data.join(DATABASE_FILE)
    }

    fn check(&self) -> Result<(), SettingsError> {
        check_range("workers", self.workers, 0..=1_024)?;
        check_store(&self.store)?;
        check_queue(&self.queue)?;
        check_http(&self.http)?;
        check_uploads(&self.uploads)?;
        check_live(&self.live)?;
        check_analysis(&self.analysis)?;
        check_range("rescoring.open", self.rescoring.open, 1..=1_000)?;
        check_range("rescoring.look_ms", self.rescoring.look_ms, 1..=3_600_000)?;
        check_range("backup.keep", self.backup.keep, 1..=10_000)?;
        check_range("retention.videos_months", self.retention.videos_months, 0..=1_200)?;
        check_range("retention.erase_days", self.retention.erase_days, 0..=365)?;
        check_range("retention.access_log_months", self.retention.access_log_months, 0..=1_200)?;
        check_range("retention.unnamed_days", self.retention.unnamed_days, 1..=365)?;
        check_range("upkeep.collect_s", self.upkeep.collect_s, 1..=86_400)?;
        let wrong = |(key, value, expected)| SettingsError::Value { key, value, expected };
        self.single_sign_on.check().map_err(wrong)?;
        check_range("inbox.poll_s", self.inbox.poll_s, 1..=3_600)?;
        check_range("inbox.settle_s", self.inbox.settle_s, 1..=3_600)?;
        self.check_inbox()?;
        self.check_tls()?;
        self.check_backup()
    }

    /// Backups need a folder of their own: a relative path depends on where the service is started, and a backup in the
    /// data folder is lost with it.
    fn check_backup(&self) -> Result<(), SettingsError> {
        let Some(target) = &self.backup.target else { return Ok(()) };
        let refused = |value, expected| Err(SettingsError::Value { key: "backup.target", value, expected });
        if target.as_os_str().is_empty() {
            return refused("empty".to_owned(), "the absolute path of a folder, or no such setting: no backups then");
        }
        let value = format!("`{}`", target.display());
        if !target.is_absolute() {
            return refused(value, "an absolute path, such as /backup/trocar");
        }
        if resolved(target).starts_with(resolved(&self.data)) {
            return refused(
                value,
                "a folder outside the data folder, best on another disk: it is lost with the data there",
            );
        }
        Ok(())
    }

    /// The service moves and deletes files in the watched folder: the data folder must not be in it, nor the other way
    /// round.
    fn check_inbox(&self) -> Result<(), SettingsError> {
        let Some(folder) = &self.inbox.folder else { return Ok(()) };
        let refused = |value, expected| Err(SettingsError::Value { key: "inbox.folder", value, expected });
        if folder.as_os_str().is_empty() {
            return refused("empty".to_owned(), "the path of a folder, or no such setting: no folder is watched then");
        }
        let (inbox, data) = (resolved(folder), resolved(&self.data));
        if inbox.starts_with(&data) || data.starts_with(&inbox) {
            return refused(format!("`{}`", folder.display()), "a folder outside the data folder, and not around it");
        }
        Ok(())
    }

    /// HTTPS needs certificate and key, and a redirect needs HTTPS.
    fn check_tls(&self) -> Result<(), SettingsError> {
        let TlsSettings { certificate, key, redirect_listen } = &self.tls;
        let missing = |key, expected| Err(SettingsError::Value { key, value: "not set".to_owned(), expected });
        match (certificate, key) {
            (Some(_), None) => missing("tls.key", "the file with the private key of tls.certificate"),
            (None, Some(_)) => missing("tls.certificate", "the file with the certificate of tls.key"),
            (None, None) if redirect_listen.is_some() => {
                missing("tls.certificate", "a certificate, since tls.redirect_listen redirects to HTTPS")
            }
            _ => Ok(()),
        }
    }
}

/// The absolute path, without symbolic links in the part that exists.
fn resolved(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let existing = path.ancestors().find_map(|ancestor| Some((ancestor.canonicalize().ok()?, ancestor)));
    let Some((mut real, ancestor)) = existing else { return path };
    for part in path.strip_prefix(ancestor).unwrap_or(&path).components() {
        match part {
            Component::ParentDir => drop(real.pop()),
            other => real.push(other),
        }
    }
    real
}

/// True for `http` or `https` with a host and at most a path.
fn is_web_address(text: &str) -> bool {
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | ':' | '/' | '[' | ']' | '_' | '~');
    host.is_some_and(|host| !host.is_empty() && !host.starts_with('/') && host.chars().all(plain))
}

fn read(path: &Path) -> Result<Table, SettingsError> {
    let unreadable = |source| SettingsError::Read { path: path.to_owned(), source };
    let wrong = |why: String| SettingsError::File { path: path.to_owned(), why };
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    let table: Table = toml::from_str(&text).map_err(|error| wrong(one_line(&error)))?;
    toml::from_str::<Settings>(&text).map_err(|error| wrong(one_line(&error)))?;
    Ok(table)
}

/// Sets one value from an environment variable, and checks that the key exists and the type fits.
fn set_from_variable(table: &mut Table, name: &str, text: &str) -> Result<(), SettingsError> {
    let key = name.strip_prefix(PREFIX).unwrap_or(name).to_ascii_lowercase();
    let value = parse_value(text);
    let alone = match key.split_once("__") {
        Some((section, key)) => {
            Table::from_iter([(section.to_owned(), Value::Table(single_entry(key, value.clone())))])
        }
        None => single_entry(&key, value.clone()),
    };
    parse(alone).map_err(|why| SettingsError::Variable { name: name.to_owned(), why })?;
    match key.split_once("__") {
        Some((section, key)) => {
            let section = table.entry(section.to_owned()).or_insert_with(|| Value::Table(Table::new()));
            section.as_table_mut().map(|section| section.insert(key.to_owned(), value));
        }
        None => drop(table.insert(key, value)),
    }
    Ok(())
}

fn single_entry(key: &str, value: Value) -> Table {
    Table::from_iter([(key.to_owned(), value)])
}

/// A variable's value, read as TOML: `30` is a number, `true` a boolean; what is not TOML is text.
fn parse_value(text: &str) -> Value {
    let read = toml::from_str::<Table>(&format!("value = {text}")).ok();
    read.and_then(|mut table| table.remove("value")).unwrap_or_else(|| Value::String(text.to_owned()))
}

fn parse(table: Table) -> Result<Settings, String> {
    table.try_into::<Settings>().map_err(|error| one_line(&error))
}

fn one_line(error: &toml::de::Error) -> String {
    error.to_string().trim().replace('\n', " ")
}

fn check_store(store: &StoreSettings) -> Result<(), SettingsError> {
    check_range("store.readers", store.readers, 1..=64)?;
    check_range("store.waiting_writes", store.waiting_writes, 1..=100_000)?;
    check_range("store.writes_per_commit", store.writes_per_commit, 1..=10_000)?;
    check_range("store.busy_timeout_ms", store.busy_timeout_ms, 100..=600_000)?;
    check_range("store.max_attempts", store.max_attempts, 1..=20)?;
    check_range("store.senders.uploads", store.senders.uploads, 1..=1_000_000)?;
    check_range("store.senders.feeds", store.senders.feeds, 1..=1_000)?;
    check_range("store.senders.daily_recordings", store.senders.daily_recordings, 1..=1_000_000)?;
    check_range("store.senders.daily_bytes", store.senders.daily_bytes, RECORDING_BYTES)?;
    check_range("store.senders.sign_ins", store.senders.sign_ins, 1..=10_000)
}

fn check_queue(queue: &QueueSettings) -> Result<(), SettingsError> {
    check_range("queue.heartbeat_s", queue.heartbeat_s, 1..=3_600)?;
    check_range("queue.sweep_s", queue.sweep_s, 1..=3_600)?;
    check_range("queue.look_s", queue.look_s, 1..=3_600)?;
    if queue.lease_s < 2 * queue.heartbeat_s || queue.lease_s > 86_400 {
        let expected = "at least two heartbeats (queue.heartbeat_s) and at most a day";
        return Err(SettingsError::Value { key: "queue.lease_s", value: queue.lease_s.to_string(), expected });
    }
    Ok(())
}

fn check_http(http: &HttpSettings) -> Result<(), SettingsError> {
    check_range("http.max_connections", http.max_connections, 1..=1_000_000)?;
    check_range("http.head_timeout_s", http.head_timeout_s, 1.0..=3_600.0)?;
    check_range("http.min_body_rate", http.min_body_rate, 1..=1 << 30)?;
    check_range("http.body_grace_s", http.body_grace_s, 1.0..=3_600.0)?;
    check_range("http.write_timeout_s", http.write_timeout_s, 1.0..=3_600.0)?;
    check_range("http.max_json_bytes", http.max_json_bytes, 1_024..=64 << 20)?;
    check_range("http.max_form_bytes", http.max_form_bytes, 1_024..=1 << 50)?;
    check_range("http.idle_min", http.idle_min, 1..=24 * 60)?;
    check_range("http.sign_in_h", http.sign_in_h, 1..=24 * 7)?;
    check_range("http.password_link_h", http.password_link_h, 1..=24 * 30)?;
    check_range("http.invitation_days", http.invitation_days, 1..=90)?;
    check_range("http.free_attempts", http.free_attempts, 1..=10_000)?;
    check_range("http.hsts_days", http.hsts_days, 0..=3_650)?;
    check_range("http.max_event_streams", http.max_event_streams, 1..=100_000)?;
    check_range("http.max_event_streams_of_one", http.max_event_streams_of_one, 1..=100_000)?;
    check_range("http.max_heavy_answers", http.max_heavy_answers, 1..=1_000)?;
    check_range("http.max_heavy_answers_of_one", http.max_heavy_answers_of_one, 1..=1_000)?;
    check_range("http.heavy_answer_wait_s", http.heavy_answer_wait_s, 1.0..=3_600.0)?;
    check_range("http.page_items", http.page_items, 1..=200)?;
    if let Some(network) = http.trusted_proxies.iter().find(|network| network.prefix_len() == 0) {
        let expected = "the addresses of your proxies only: every client in a network of them can forge its address";
        return Err(SettingsError::Value { key: "http.trusted_proxies", value: network.to_string(), expected });
    }
    check_public_url(http)
}

fn check_public_url(http: &HttpSettings) -> Result<(), SettingsError> {
    let Some(url) = &http.public_url else { return Ok(()) };
    let refused = |expected| Err(SettingsError::Value { key: "http.public_url", value: url.clone(), expected });
    if !is_web_address(url) {
        return refused("the service's address, such as https://skills.example");
    }
    if !url.trim_end_matches('/').ends_with(&http.base_path.to_string()) {
        return refused("the service's address, which ends with http.base_path");
    }
    Ok(())
}

fn check_uploads(uploads: &UploadSettings) -> Result<(), SettingsError> {
    check_range("uploads.max_bytes", uploads.max_bytes, RECORDING_BYTES)?;
    check_range("uploads.expire_h", uploads.expire_h, 1..=24 * 365)?;
    check_range("uploads.empty_min", uploads.empty_min, 1..=24 * 60)?;
    check_range("uploads.max_unfinished", uploads.max_unfinished, 1..=1_000_000)?;
    check_range("uploads.max_waiting", uploads.max_waiting, 1..=1_000_000)?;
    check_range("uploads.import_bytes", uploads.import_bytes, 1_024..=1 << 30)?;
    check_range("uploads.import_rows", uploads.import_rows, 2..=10_000_000)
}

fn check_live(live: &LiveSettings) -> Result<(), SettingsError> {
    check_range("live.max_feeds", live.max_feeds, 1..=10_000)?;
    check_range("live.max_bytes", live.max_bytes, RECORDING_BYTES)?;
    check_range("live.max_unfinished", live.max_unfinished, 2..=10_000)?; // half of them are for people
    check_range("live.ack_ms", live.ack_ms, 1..=10_000)?;
    check_range("live.silent_s", live.silent_s, 10..=3_600)?; // senders report every 5 s
    check_range("live.abandoned_s", live.abandoned_s, 1..=7 * 86_400)?;
    check_range("live.lost_s", live.lost_s, 1..=7 * 86_400)?;
    check_range("live.closed_s", live.closed_s, 1..=7 * 86_400)?;
    check_range("live.empty_s", live.empty_s, 1..=7 * 86_400)
}

fn check_analysis(analysis: &AnalysisSettings) -> Result<(), SettingsError> {
    check_range("analysis.decoder_threads", analysis.decoder_threads, 1..=64)?;
    check_range("analysis.memory_mib", analysis.memory_mib, CHILD_MIB)?;
    check_range("analysis.longest_s", analysis.longest_s, 60..=7 * 86_400)?;
    check_range("analysis.silence_s", analysis.silence_s, 5..=3_600)?;
    check_range("analysis.scoring_memory_mib", analysis.scoring_memory_mib, CHILD_MIB)?;
    check_range("analysis.scoring_s", analysis.scoring_s, 10..=86_400)?;
    check_range("analysis.glances", analysis.glances, 1..=64)?;
    check_range("analysis.glance_s", analysis.glance_s, 1..=600)
}

/// Limits of a limit on the bytes of recordings: 1 MiB to 1 PiB.
const RECORDING_BYTES: RangeInclusive<u64> = 1 << 20..=1 << 50;
/// Limits of a child's memory, MiB. With less than the first, no usual recording can be decoded.
const CHILD_MIB: RangeInclusive<u64> = 128..=1 << 20;

fn check_range<T: PartialOrd + Display>(
    key: &'static str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), SettingsError> {
    if range.contains(&value) {
        return Ok(());
    }
    let value = format!("{value}, which is outside {} to {}", range.start(), range.end());
    Err(SettingsError::Value { key, value, expected: "a number in this range" })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(variables: &[(&str, &str)]) -> Result<Settings, SettingsError> {
        let variables: Vec<_> = variables.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect();
        Settings::from_parts(Flags::default(), &variables)
    }

    fn with_file(text: &str, variables: &[(&str, &str)], flags: Flags) -> Result<Settings, SettingsError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings.toml");
        std::fs::write(&path, text).unwrap();
        let variables: Vec<_> = variables.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect();
        Settings::from_parts(Flags { settings: Some(path), ..flags }, &variables)
    }

    #[test]
    fn nothing_set_is_the_defaults() {
        assert_eq!(with(&[]).unwrap(), Settings::default());
    }

    #[test]
    fn flags_win_over_variables_and_variables_over_the_file() {
        let file = "workers = 3\nlisten = \"0.0.0.0:1\"\n[queue]\nlease_s = 40\nsweep_s = 4\n";
        let flags = Flags { listen: Some(([127, 0, 0, 1], 9).into()), ..Flags::default() };
        let variables = [("TROCAR_LISTEN", "0.0.0.0:2"), ("TROCAR_QUEUE__LEASE_S", "50")];
        let settings = with_file(file, &variables, flags).unwrap();
        assert_eq!((settings.workers, settings.listen.port()), (3, 9));
        assert_eq!((settings.queue.lease_s, settings.queue.sweep_s, settings.queue.look_s), (50, 4, 5));
    }

    #[test]
    fn a_certificate_needs_its_key_and_a_redirect_needs_a_certificate() {
        let (certificate, key) = (("TROCAR_TLS__CERTIFICATE", "c.pem"), ("TROCAR_TLS__KEY", "k.pem"));
        let redirect = ("TROCAR_TLS__REDIRECT_LISTEN", "127.0.0.1:80");
        let refused = |variables: &[(&str, &str)]| with(variables).unwrap_err().to_string();
        assert!(refused(&[certificate]).starts_with("setting `tls.key` is not set"));
        assert!(refused(&[key]).starts_with("setting `tls.certificate` is not set"));
        assert!(refused(&[redirect]).starts_with("setting `tls.certificate` is not set"));
        let settings = with(&[certificate, key, redirect]).unwrap();
        assert_eq!(settings.tls.redirect_listen.map(|address| address.port()), Some(80));
    }

    #[test]
    fn backups_need_an_absolute_folder_outside_the_data() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        std::fs::create_dir(&data).unwrap();
        std::os::unix::fs::symlink(&data, folder.path().join("link")).unwrap();
        let with_target = |target: &str| {
            let flags = Flags { data: Some(data.clone()), ..Flags::default() };
            Settings::from_parts(flags, &[("TROCAR_BACKUP__TARGET".to_owned(), target.to_owned())])
        };
        let inside = |name: &str| folder.path().join(name).display().to_string();
        for (target, expected) in [
            (String::new(), "is empty"),
            ("backups".to_owned(), "an absolute path"),
            (inside("data"), "outside the data folder"),
            (inside("data/backups/daily"), "outside the data folder"),
            (inside("link/backups"), "outside the data folder"),
            (inside("other/../data/backups"), "outside the data folder"),
        ] {
            let refused = with_target(&target).unwrap_err().to_string();
            assert!(refused.contains("backup.target") && refused.contains(expected), "{target}: {refused}");
        }
        assert!(with_file("[backup]\ntarget = \"\"\n", &[], Flags::default()).is_err());
        for target in [inside("data-backup"), inside("")] {
            assert!(with_target(&target).is_ok(), "{target}");
        }
    }

    #[test]
    fn a_misspelt_key_is_an_error_that_names_it() {
        let file = with_file("[queue]\nleases_s = 40\n", &[], Flags::default()).unwrap_err().to_string();
        assert!(file.contains("leases_s") && file.contains("settings.toml"), "{file}");
        let variable = with(&[("TROCAR_QUEUE__LEASES_S", "40")]).unwrap_err().to_string();
        assert!(variable.contains("TROCAR_QUEUE__LEASES_S") && variable.contains("leases_s"), "{variable}");
        assert!(with(&[("TROCAR_QUEU__LEASE_S", "40")]).is_err());
    }

    #[test]
    fn the_public_address_ends_with_the_path_that_the_service_lies_under() {
        let with_both = |url, path| with(&[("TROCAR_HTTP__PUBLIC_URL", url), ("TROCAR_HTTP__BASE_PATH", path)]);
        for (url, path) in
            [("https://a.example/trocar/", "/trocar"), ("https://a.example", "/"), ("https://a.example/any", "")]
        {
            assert!(with_both(url, path).is_ok(), "{url} with {path}");
        }
        for url in ["https://a.example", "https://a.example/other", "https://a.example/trocar/more"] {
            let refused = with_both(url, "/trocar").unwrap_err().to_string();
            assert!(refused.contains("http.public_url") && refused.contains("http.base_path"), "{refused}");
        }
        let refused = with(&[("TROCAR_HTTP__BASE_PATH", "trocar")]).unwrap_err().to_string();
        assert!(refused.contains("expected one such as /trocar"), "{refused}");
    }

    #[test]
    fn a_value_of_the_wrong_type_names_its_variable() {
        let error = with(&[("TROCAR_WORKERS", "many")]).unwrap_err().to_string();
        assert!(error.starts_with("environment variable TROCAR_WORKERS: "), "{error}");
        assert!(!error.contains('\n'));
    }

    #[test]
    fn limits_that_contradict_each_other_are_refused() {
        let error = with(&[("TROCAR_QUEUE__LEASE_S", "19")]).unwrap_err().to_string();
        assert!(error.contains("queue.lease_s") && error.contains("two heartbeats"), "{error}");
        let error = with(&[("TROCAR_STORE__READERS", "0")]).unwrap_err().to_string();
        assert!(error.contains("store.readers"), "{error}");
    }

    /// Keys whose value may be 0.
    const MAY_BE_ZERO: [&str; 5] =
        ["workers", "http.hsts_days", "retention.videos_months", "retention.erase_days", "retention.access_log_months"];
    /// An earlier name of a key, and the present one.
    const EARLIER_NAME: (&str, &str) = ("http.attempts_per_min", "http.free_attempts");

    /// The settings with one more value in the file. `key` includes its section.
    fn with_key(key: &str, value: &str) -> Result<Settings, SettingsError> {
        let line = match key.rsplit_once('.') {
            Some((section, key)) => format!("[{section}]\n{key} = {value}\n"),
            None => format!("{key} = {value}\n"),
        };
        with_file(&line, &[], Flags::default())
    }

    /// All keys below a section, as the error for an unknown key lists them.
    fn keys_below(section: &str) -> Vec<String> {
        let prefix = if section.is_empty() { String::new() } else { format!("{section}.") };
        let refused = with_key(&format!("{prefix}unknown"), "0").unwrap_err().to_string();
        let Some((_, expected)) = refused.split_once("expected ") else {
            return vec![section.to_owned()]; // a table whose keys the administrator chooses
        };
        let known = expected.split(" in `").next().unwrap_or_default().split('`').skip(1).step_by(2);
        let of_key = |key: String| {
            let is_section = with_file(&format!("[{key}]\n"), &[], Flags::default()).is_ok();
            if is_section { keys_below(&key) } else { vec![key] }
        };
        known.map(|key| format!("{prefix}{key}")).flat_map(of_key).collect()
    }

    #[test]
    fn every_number_has_a_range_that_is_checked_at_the_start() {
        let is_refused_by_type = |result: &Result<_, _>| matches!(result, Err(SettingsError::File { .. }));
        let numbers: Vec<String> =
            keys_below("").into_iter().filter(|key| !is_refused_by_type(&with_key(key, "1"))).collect();
        assert!(numbers.len() > 50, "{numbers:?}");
        for key in numbers {
            let present = if key == EARLIER_NAME.0 { EARLIER_NAME.1 } else { key.as_str() };
            let check = |value: &str, result: Result<Settings, SettingsError>| match result {
                Err(SettingsError::Value { key: named, .. }) => assert_eq!(named, present, "{key} = {value}"),
                other => panic!("{key} = {value} is not refused as out of range: {other:?}"),
            };
            // The larger value does not fit into every type.
            let tried = [i64::MAX, u32::MAX.into()].map(|value| value.to_string());
            let fits = tried.iter().map(|value| (value, with_key(&key, value)));
            let (value, result) = fits.into_iter().find(|(_, result)| !is_refused_by_type(result)).unwrap();
            check(value, result);
            if !MAY_BE_ZERO.contains(&key.as_str()) {
                check("0", with_key(&key, "0"));
            }
        }
        let refused = with_key("analysis.memory_mib", "1").unwrap_err().to_string();
        assert!(refused.contains("`analysis.memory_mib` is 1") && refused.contains("128 to 1048576"), "{refused}");
        assert!(with_key("http.head_timeout_s", "nan").is_err() && with_key("http.head_timeout_s", "-inf").is_err());
    }

    #[test]
    fn the_documents_list_every_key() {
        let document = include_str!("../docs/operations.md");
        let (_, table) = document.split_once("| key | default | meaning |\n").unwrap();
        let (mut section, mut documented) = (String::new(), Vec::new());
        for row in table.lines().skip(1).take_while(|row| row.starts_with('|')) {
            for name in row.split('|').nth(1).unwrap_or_default().split('`').skip(1).step_by(2) {
                match name.strip_prefix('[') {
                    Some(name) => section = format!("{}.", name.trim_end_matches(']')),
                    None => documented.push(format!("{section}{name}")),
                }
            }
        }
        let mut known = keys_below("");
        known.sort_unstable();
        documented.sort_unstable();
        assert_eq!(documented, known);
    }

    #[test]
    fn a_network_of_proxies_cannot_be_the_whole_internet() {
        for network in ["0.0.0.0/0", "::/0"] {
            let refused = with_key("http.trusted_proxies", &format!("[\"127.0.0.1\", \"{network}\"]"));
            let refused = refused.unwrap_err().to_string();
            assert!(refused.contains("http.trusted_proxies") && refused.contains(network), "{refused}");
        }
        assert!(with_key("http.trusted_proxies", "[\"10.0.0.0/8\", \"::1\"]").is_ok());
    }

    #[test]
    fn a_named_file_that_is_missing_is_an_error() {
        let flags = Flags { settings: Some("/nowhere/settings.toml".into()), ..Flags::default() };
        assert!(matches!(Settings::from_parts(flags, &[]), Err(SettingsError::Read { .. })));
    }
}
