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

use std::net::SocketAddr;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use toml::{Table, Value};

use crate::analysis::AnalysisSettings;
use crate::domain::rights::RightsSettings;
use crate::http::settings::HttpSettings;
use crate::http::tls::TlsSettings;
use crate::intake::UploadSettings;
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
    /// Certificate and key for HTTPS.
    pub tls: TlsSettings,
    /// Child processes that decode and track.
    pub analysis: AnalysisSettings,
    /// Uploads of recordings.
    pub uploads: UploadSettings,
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
            tls: TlsSettings::default(),
            analysis: AnalysisSettings::default(),
            uploads: UploadSettings::default(),
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
        settings.check()?;
        Ok(settings)
    }

    /// Path of the database.
    pub fn database(&self) -> PathBuf {
        self.data.join(DATABASE_FILE)
    }

    fn check(&self) -> Result<(), SettingsError> {
        let Settings { store, queue, http, uploads, rescoring, upkeep, .. } = self;
        check_range("store.readers", store.readers.into(), 1, 64)?;
        check_range("store.waiting_writes", store.waiting_writes as u64, 1, 100_000)?;
        check_range("store.writes_per_commit", store.writes_per_commit as u64, 1, 10_000)?;
        check_range("store.busy_timeout_ms", store.busy_timeout_ms, 100, 600_000)?;
        check_range("store.max_attempts", store.max_attempts.into(), 1, 20)?;
        check_range("store.senders.uploads", store.senders.uploads, 1, 1_000_000)?;
        check_range("store.senders.feeds", store.senders.feeds, 1, 1_000)?;
        check_range("store.senders.daily_recordings", store.senders.daily_recordings, 1, 1_000_000)?;
        check_range("store.senders.daily_bytes", store.senders.daily_bytes, 1, 1 << 50)?;
        check_range("store.senders.sign_ins", store.senders.sign_ins.into(), 1, 10_000)?;
        check_range("queue.heartbeat_s", queue.heartbeat_s, 1, 3_600)?;
        check_range("queue.sweep_s", queue.sweep_s, 1, 3_600)?;
        check_range("queue.look_s", queue.look_s, 1, 3_600)?;
        check_range("http.max_connections", http.max_connections as u64, 1, 1_000_000)?;
        check_range("http.min_body_rate", http.min_body_rate, 1, 1 << 30)?;
        check_range("http.max_json_bytes", http.max_json_bytes as u64, 1_024, 64 << 20)?;
        check_range("http.max_form_bytes", http.max_form_bytes, 1_024, 1 << 50)?;
        check_range("http.idle_min", http.idle_min, 1, 24 * 60)?;
        check_range("http.sign_in_h", http.sign_in_h, 1, 24 * 7)?;
        check_range("http.free_attempts", http.free_attempts.into(), 1, 10_000)?;
        check_range("http.hsts_days", http.hsts_days.into(), 0, 3_650)?;
        check_range("http.max_event_streams", http.max_event_streams as u64, 1, 100_000)?;
        check_range("http.max_event_streams_of_one", http.max_event_streams_of_one as u64, 1, 100_000)?;
        check_range("http.max_heavy_answers", http.max_heavy_answers as u64, 1, 1_000)?;
        check_range("http.max_heavy_answers_of_one", http.max_heavy_answers_of_one as u64, 1, 1_000)?;
        check_range("http.page_items", http.page_items.into(), 1, 200)?;
        check_range("uploads.max_bytes", uploads.max_bytes, 1, 1 << 50)?;
        check_range("uploads.expire_h", uploads.expire_h, 1, 24 * 365)?;
        check_range("uploads.empty_min", uploads.empty_min, 1, 24 * 60)?;
        check_range("uploads.max_unfinished", uploads.max_unfinished, 1, 1_000_000)?;
        check_range("uploads.import_bytes", uploads.import_bytes as u64, 1_024, 1 << 30)?;
        check_range("uploads.import_rows", uploads.import_rows as u64, 2, 10_000_000)?;
        check_range("rescoring.open", rescoring.open.into(), 1, 1_000)?;
        check_range("rescoring.look_ms", rescoring.look_ms, 1, 3_600_000)?;
        check_range("backup.keep", self.backup.keep as u64, 1, 10_000)?;
        check_range("retention.videos_months", self.retention.videos_months.into(), 0, 1_200)?;
        check_range("retention.erase_days", self.retention.erase_days.into(), 0, 365)?;
        check_range("upkeep.collect_s", upkeep.collect_s, 1, 86_400)?;
        check_range("workers", self.workers as u64, 0, 1_024)?;
        if let Some(url) = http.public_url.as_ref().filter(|url| !is_web_address(url)) {
            let expected = "the service's address, such as https://skills.example";
            return Err(SettingsError::Value { key: "http.public_url", value: url.clone(), expected });
        }
        let is_below = |url: &String| url.trim_end_matches('/').ends_with(&http.base_path.to_string());
        if let Some(url) = http.public_url.as_ref().filter(|url| !is_below(url)) {
            let expected = "the service's address, which ends with http.base_path";
            return Err(SettingsError::Value { key: "http.public_url", value: url.clone(), expected });
        }
        self.check_tls()?;
        self.check_backup()?;
        if queue.lease_s < 2 * queue.heartbeat_s || queue.lease_s > 86_400 {
            let expected = "at least two heartbeats (queue.heartbeat_s) and at most a day";
            return Err(SettingsError::Value { key: "queue.lease_s", value: queue.lease_s.to_string(), expected });
        }
        Ok(())
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

fn check_range(key: &'static str, value: u64, least: u64, most: u64) -> Result<(), SettingsError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let value = format!("{value}, which is outside {least} to {most}");
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

    #[test]
    fn a_named_file_that_is_missing_is_an_error() {
        let flags = Flags { settings: Some("/nowhere/settings.toml".into()), ..Flags::default() };
        assert!(matches!(Settings::from_parts(flags, &[]), Err(SettingsError::Read { .. })));
    }
}
