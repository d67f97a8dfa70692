//! `trocar serve`: the whole service: HTTP, dashboard, queue and workers.
//!
//! The first start creates the data folder, the schema and an administrator. A file has the password until it is
//! changed; a terminal or a pipe gets it as well, but no file, journal or log of a container. The start after an update
//! copies the database, then adapts it. Every start makes files and database consistent before it listens. SIGTERM and
//! SIGINT end the service within ten seconds: open requests finish, partial uploads are kept, leases are released.

use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use clap::builder::FalseyValueParser;
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use tokio::task::JoinHandle;
use tracing_subscriber::EnvFilter;

use super::backup_command::backup_command;
use super::demonstration::{self, DemonstrationBuilder};
use super::greeting::{Greeting, print_line};
use super::{CommandFailure, restrict_new_files_to_owner};
use crate::access_log::AccessLog;
use crate::analysis::stored_rows::StoredIndexes;
use crate::analysis::{AnalysisSettings, QuickAnalysis, WorkerPool};
use crate::box_agents::BoxAgents;
use crate::certificates::Certificates;
use crate::cohorts::Cohorts;
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::Password;
use crate::events::EventBus;
use crate::heap;
use crate::http::auth::open_sign_ins::OpenSignIns;
use crate::http::auth::password::PasswordHasher;
use crate::http::auth::throttle::Throttle;
use crate::http::base_url::local_readers;
use crate::http::connection_slots::ConnectionSlots;
use crate::http::data_export::MAX_EXPORTS;
use crate::http::heavy::HeavyAnswers;
use crate::http::listeners::Listeners;
use crate::http::sessions::WatchedSessions;
use crate::http::single_sign_on::SingleSignOn;
use crate::http::state::{App, AppParts, ServiceInfo};
use crate::http::tls::ServerCertificate;
use crate::identity_provider::IdentityProvider;
use crate::intake::Intake;
use crate::intake::inbox::Inbox;
use crate::live::{self, FeedService, OpenFeeds};
use crate::motion::PIPELINE_VERSION;
use crate::queue::Queue;
use crate::rescoring::{self, RescoringSettings};
use crate::sandbox::{self, Program};
use crate::settings::{DATABASE_FILE, Flags, Settings};
use crate::shutdown::Shutdown;
use crate::store::{NewPerson, Store};
use crate::time::{SharedClock, SystemClock};
use crate::upkeep::{self, BACKUP_MARK, BackupState, ErasureListState, ErasureLists};
use crate::vault::{DataFolderLock, Vault};

/// Time for all tasks to end after the shutdown began.
const SHUTDOWN_GRACE: Duration = Duration::from_secs(9);
/// Requested limit of open files. The system's hard limit may be lower.
const MAX_OPEN_FILES: u64 = 65_536;
/// Agents that may stand by at a time. Each holds a connection.
const MAX_AGENTS: usize = 1024;
/// Connections of one box's agent: the present one, and some that were cut and have not been noticed yet.
const MAX_AGENTS_OF_BOX: usize = 4;
/// Login of the first administrator.
const ADMINISTRATOR: &str = "administrator";

/// Arguments of `trocar serve`.
#[derive(clap::Args)]
pub struct ServeArgs {
    /// Folder for database, recordings and results; the first start creates it [default: trocar-data]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Address to listen on [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDRESS:PORT")]
    listen: Option<SocketAddr>,
    /// Number of recordings tracked at the same time [default: half the cores]
    #[arg(long, value_name = "N")]
    workers: Option<usize>,
    /// Folder that is watched for recordings; they wait for a name, or are assigned by its list people.csv
    #[arg(long, value_name = "FOLDER")]
    inbox: Option<PathBuf>,
    /// Fill a new data folder with a demonstration: a simulated box, trainees and recordings
    #[arg(long)]
    demo: bool,
    /// Print only the name of the file with the first password, also to a terminal or a pipe
    #[arg(long, env = "TROCAR_HIDE_PASSWORD", value_parser = FalseyValueParser::new())]
    hide_password: bool,
    /// Settings file [default: trocar.toml in the data folder]
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Log filter, such as `info` or `trocar=debug`
    #[arg(long, value_name = "FILTER", env = "TROCAR_LOG", default_value = "info")]
    log: String,
    /// Write the log as JSON, one object per line
    #[arg(long)]
    log_json: bool,
}

/// Runs the command.
pub fn run(args: ServeArgs) -> Result<(), CommandFailure> {
    start_log(&args.log, args.log_json)?;
    heap::return_large_blocks().context("limiting memory")?;
    sandbox::run_soon_after_waking();
    let ServeArgs { settings, data, listen, workers, inbox, .. } = args;
    let flags = Flags { settings, data, listen, workers, inbox };
    let mut settings = Settings::load(flags).map_err(CommandFailure::input)?;
    settings.workers = worker_count(settings.workers);
    restrict_new_files_to_owner();
    // Each connection needs a file descriptor, and the usual soft limit is below `http.max_connections`.
    if let Err(error) = rlimit::increase_nofile_limit(MAX_OPEN_FILES) {
        tracing::warn!(%error, "cannot raise the limit of open files; many connections may fail");
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    let served = runtime.block_on(serve(settings, args.demo, Greeting::new(args.hide_password)));
    runtime.shutdown_timeout(Duration::from_millis(500));
    Ok(served?)
}

/// Starts the log on stderr: stdout is for the address and how to sign in.
fn start_log(filter: &str, json: bool) -> Result<(), CommandFailure> {
    let filter =
        EnvFilter::try_new(filter).with_context(|| format!("--log {filter}")).map_err(CommandFailure::input)?;
    let on_a_terminal = std::io::stderr().is_terminal();
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_ansi(on_a_terminal).with_writer(std::io::stderr);
    if json {
        log.json().init()
    } else {
        log.init()
    }
    Ok(())
}

async fn serve(settings: Settings, demo: bool, greeting: Greeting) -> anyhow::Result<()> {
    let password = Password::random();
    let (data, scratch) = (settings.data.clone(), settings.data.join("demonstration"));
    let running = start(settings, Arc::new(SystemClock), &password, WorkerPool::this_program()).await?;
    running.shutdown.begin_on_signals().context("listening for signals")?;
    print_welcome(&running);
    greeting.print_sign_in(&data, ADMINISTRATOR, running.is_first_start.then_some(&password));
    if demo {
        start_demonstration(&running, &greeting, &data, scratch)
            .await
            .context("registering the demonstration centre")?;
    }
    running.ended().await;
    Ok(())
}

/// The number of workers for a setting. 0 means half the cores, because a recording keeps about two cores busy.
fn worker_count(set: usize) -> usize {
    match set {
        0 => std::thread::available_parallelism().map_or(1, |cores| cores.get().div_ceil(2)),
        some => some,
    }
}

/// Fills a new data folder with the demonstration centre, or continues where an earlier start stopped. Does nothing in
/// a data folder that is in real use.
async fn start_demonstration(
    running: &RunningService,
    greeting: &Greeting,
    data: &Path,
    scratch: PathBuf,
) -> anyhow::Result<()> {
    let builder = DemonstrationBuilder::new(&running.app, scratch);
    if !running.is_first_start && !builder.is_registered().await? {
        print_line(
            "This data folder is already in use, so no demonstration is added. Use --demo with a new data folder.",
        );
        return Ok(());
    }
    let password = builder.register().await?;
    greeting.print_sign_in(data, demonstration::INSTRUCTOR, password.as_ref());
    running.shutdown.spawn(builder.fill(running.shutdown.clone()));
    Ok(())
}

/// A running service.
pub struct RunningService {
    /// Address that it listens on.
    pub address: SocketAddr,
    /// Address whose plain HTTP requests it redirects.
    pub redirect_address: Option<SocketAddr>,
    /// Its shutdown.
    pub shutdown: Shutdown,
    /// True if this start created the first administrator, with the given password.
    pub is_first_start: bool,
    app: App,
    served: JoinHandle<()>,
    _lock: DataFolderLock,
}

impl RunningService {
    /// Waits until the shutdown has begun and the service has ended.
    pub async fn ended(self) {
        // Both at once, so that open requests and background tasks share the same grace time.
        let (served, finished) = tokio::join!(self.served, self.shutdown.finished(SHUTDOWN_GRACE));
        if served.is_err() {
            tracing::error!("accept loop panicked");
        }
        if !finished {
            tracing::warn!("some tasks did not end in time; the next start recovers them");
        }
    }
}

/// Says that the address in the settings, which certificates have for ever, cannot be opened from elsewhere.
fn warn_of_local_address(public_url: Option<&str>) {
    let Some(readers) = public_url.and_then(local_readers) else { return };
    let public_url = public_url.unwrap_or_default();
    tracing::warn!(
        public_url,
        "http.public_url can be opened {readers}: certificates ask before they are issued with it, and single sign-on \
         works only there"
    );
}

/// Starts a service: recovers the data, listens, and starts the workers. `password` is for the first administrator, who
/// is created if there is no account yet. `child` is the program for child processes: this program, except in tests.
pub async fn start(
    settings: Settings,
    clock: SharedClock,
    password: &Password,
    child: Program,
) -> anyhow::Result<RunningService> {
    check_kernel(settings.analysis.require_landlock)?;
    warn_of_local_address(settings.http.public_url.as_deref());
    let certificate = ServerCertificate::load(&settings.tls).await.context("using the certificate of [tls]")?;
    let single_sign_on = single_sign_on(&settings, clock.clone())?;
    let (vault, lock) = open_data_folder(&settings.data).await?;
    upkeep::prepare_database(&vault, &settings.database(), &settings.store).await.context("preparing the database")?;
    let store =
        Store::open(&settings.database(), &settings.store, clock.clone()).await.context("opening the database")?;
    upkeep::recover(&store, &vault).await.context("recovering")?.log();
    let events = EventBus::new();
    let queue = Queue::new(store.clone(), settings.queue.clone(), events.clone(), clock.clone());
    queue.recover().await.context("recovering the queue")?;
    // First the address: if it is in use, no administrator is made whose password was never shown.
    let listeners = Listeners::bind(settings.listen, settings.tls.redirect_listen).await?;
    let is_first =
        make_first_administrator(&store, &settings.data, password).await.context("making the first administrator")?;
    let shutdown = Shutdown::new();
    let (storage, jobs) = ((store.clone(), vault.clone()), (queue.clone(), events.clone()));
    let intake = Intake::new(storage, jobs, clock.clone(), shutdown.clone(), settings.uploads.clone());
    let feeds = feed_service((&store, &vault), (&queue, &events), (&clock, &shutdown), (&settings, &child));
    let quick_analysis =
        QuickAnalysis::new(vault.clone(), child.clone(), settings.analysis.clone(), clock.clone(), shutdown.clone());
    let app = App::new(AppParts {
        throttle: Throttle::new(settings.http.free_attempts, clock.clone()),
        open_sign_ins: OpenSignIns::default(),
        prepared_events: EventBus::new(),
        watched_sessions: WatchedSessions::default(),
        single_sign_on,
        password_hasher: PasswordHasher::default(),
        watcher_slots: ConnectionSlots::new(settings.http.max_event_streams, settings.http.max_event_streams_of_one),
        heavy_answers: HeavyAnswers::new(&settings.http),
        stored_indexes: StoredIndexes::default(),
        metrics: metrics().context("starting the metrics")?,
        settings: settings.http.clone(),
        rights: settings.rights,
        service_info: service_info(&settings, clock.now_ms()),
        shutdown: shutdown.clone(),
        certificates: Certificates::new(&store, &clock),
        cohorts: Cohorts::new(store.clone(), clock.clone()),
        quick_analysis,
        store,
        vault,
        intake,
        feeds,
        feed_slots: feed_slots(&settings),
        box_agents: BoxAgents::new(clock.clone()),
        agent_slots: ConnectionSlots::new(MAX_AGENTS, MAX_AGENTS_OF_BOX),
        backup_state: BackupState::default(),
        erasure_list_state: ErasureListState::default(),
        backup_settings: settings.backup.clone(),
        backup_command: backup_command(&settings, &child),
        retention: settings.retention.clone(),
        exports: ConnectionSlots::new(MAX_EXPORTS, 1),
        access_log: AccessLog::new(clock.clone()),
        queue,
        events,
        clock,
    });
    start_background(&app, settings, child);
    let (address, redirect_address) = (listeners.address(), listeners.redirect_address());
    let served = listeners.serve(certificate, app.clone()).context("starting TLS")?;
    Ok(RunningService { address, redirect_address, shutdown, is_first_start: is_first, app, served, _lock: lock })
}

/// The live feeds of this service.
fn feed_service(
    (store, vault): (&Store, &Vault),
    (queue, events): (&Queue, &EventBus),
    (clock, shutdown): (&SharedClock, &Shutdown),
    (settings, program): (&Settings, &Program),
) -> FeedService {
    FeedService::new(live::FeedServiceParts {
        store: store.clone(),
        vault: vault.clone(),
        queue: queue.clone(),
        events: events.clone(),
        clock: clock.clone(),
        shutdown: shutdown.clone(),
        settings: settings.live.clone(),
        analysis: settings.analysis.clone(),
        program: program.clone(),
        open: OpenFeeds::default(),
        cpu_slots: Arc::default(),
    })
}

/// Single sign-on, if the settings name a provider.
fn single_sign_on(settings: &Settings, clock: SharedClock) -> anyhow::Result<Option<SingleSignOn>> {
    let provider = IdentityProvider::from_settings(settings.single_sign_on.clone());
    let provider = provider.context("setting up single sign-on as [single_sign_on] says")?;
    Ok(provider.map(|provider| SingleSignOn::new(provider, clock)))
}

/// Opens the data folder, which must not be a backup, makes it if it is missing, and locks it for this service.
async fn open_data_folder(data: &Path) -> anyhow::Result<(Vault, DataFolderLock)> {
    refuse_backup(data)?;
    let shown = data.display();
    let vault = Vault::open(data).await.with_context(|| format!("opening the data folder `{shown}`"))?;
    let lock = vault.lock().await.with_context(|| format!("using {shown}"))?;
    Ok((vault, lock))
}

/// Refuses to run on a backup, or to change it: people who were erased since it was made would come back.
pub(super) fn refuse_backup(data: &Path) -> anyhow::Result<()> {
    let shown = data.display();
    anyhow::ensure!(
        !data.join(BACKUP_MARK).exists(),
        "`{shown}` is a backup, or a folder whose backup or restore was interrupted. A backup: restore it into a new \
         folder with `trocar admin restore {shown} --data NEW-FOLDER`. An interrupted one: delete it and restore again"
    );
    Ok(())
}

/// Slots for live feeds. People leave a quarter of them to the agents of boxes.
fn feed_slots(settings: &Settings) -> ConnectionSlots {
    let (most, most_of_one) = (settings.live.max_feeds, settings.store.senders.feeds as usize);
    ConnectionSlots::new(most, most_of_one).keep_for_agents(most / 4)
}

/// The facts and settings that the service reports to administrators.
fn service_info(settings: &Settings, started_at_ms: i64) -> ServiceInfo {
    ServiceInfo {
        pipeline: PIPELINE_VERSION,
        started_at_ms,
        is_https: settings.tls.certificate.is_some(),
        workers: settings.workers,
        max_upload_bytes: settings.uploads.max_bytes,
        unfinished_upload_h: settings.uploads.expire_h,
        erased_within_s: settings.upkeep.collect_s,
    }
}

/// Refuses to start on a kernel that cannot confine child processes as the settings require.
fn check_kernel(require_landlock: bool) -> anyhow::Result<()> {
    match sandbox::landlock_version() {
        Ok(_) => {}
        Err(why) if require_landlock => anyhow::bail!(
            "{why}; or set `require_landlock = false` under [analysis]: child processes are then confined only by \
             limits and the system call filter"
        ),
        Err(why) => tracing::warn!(%why, "child processes are confined only by limits and the system call filter"),
    }
    Ok(())
}

/// Starts upkeep, the watched folder, rescoring and the workers.
fn start_background(app: &App, settings: Settings, child: Program) {
    start_upkeep(app, &settings);
    start_inbox(app, &settings, child.clone());
    start_rescoring(app, settings.rescoring);
    worker_pool(app, settings.analysis, child).start_workers(settings.workers, &app.shutdown);
}

/// Starts the background tasks: rescue of expired leases, upkeep of feeds, the end of streams with their sign-ins,
/// removal of unneeded files, backups.
fn start_upkeep(app: &App, settings: &Settings) {
    let own = app.clone();
    app.shutdown.spawn(async move { own.end_streams_with_sign_ins().await });
    let own = app.clone();
    app.shutdown.spawn(async move {
        if let Some(set_up) = &own.single_sign_on {
            set_up.provider().keep_known(&own.shutdown).await;
        }
    });
    let own = app.clone();
    app.shutdown.spawn(async move { own.access_log.run(&own.store, &own.shutdown).await });
    let (own, events) = (app.clone(), app.events.subscribe());
    app.shutdown.spawn(async move { own.prepare_events(events).await });
    let (queue, stop) = (app.queue.clone(), app.shutdown.clone());
    app.shutdown.spawn(async move { queue.keep_sweeping(&stop).await });
    let feeds = app.feeds.clone();
    app.shutdown.spawn(async move { feeds.maintain().await });
    let every = Duration::from_secs(settings.upkeep.collect_s);
    let target = settings.backup.target.as_deref();
    let lists = ErasureLists::new(&settings.data, target, app.erasure_list_state.clone());
    let (own, stop) = (app.clone(), app.shutdown.clone());
    app.shutdown.spawn(async move {
        let until = (own.clock.clone(), &stop);
        upkeep::run((&own.store, &own.vault), &own.retention, lists, every, until).await;
    });
    let (own, stop, backup) = (app.clone(), app.shutdown.clone(), settings.backup.clone());
    // On a thread of its own: verifying a backup takes the processor for long.
    let runtime = tokio::runtime::Handle::current();
    let backups = move || {
        let data = (&own.store, &own.vault);
        let until = (own.clock.clone(), &stop);
        runtime.block_on(upkeep::run_backups(data, &backup, DATABASE_FILE, until, &own.backup_state));
    };
    app.shutdown.spawn(async move {
        let _ = tokio::task::spawn_blocking(backups).await; // a panic is logged where it happened
    });
}

/// Starts to watch the folder for recordings, if the settings name one.
fn start_inbox(app: &App, settings: &Settings, child: Program) {
    let (clock, shutdown) = (app.clock.clone(), app.shutdown.clone());
    // Slots of its own: people who wait for a photo do not wait for the folder.
    let pictures =
        QuickAnalysis::new(app.vault.clone(), child, settings.analysis.clone(), clock.clone(), shutdown.clone());
    if let Some(inbox) = Inbox::new(app.intake.clone(), pictures, clock, settings.inbox.clone()) {
        shutdown.spawn(inbox.run());
    }
}

/// Starts the background task that carries out rescoring orders.
fn start_rescoring(app: &App, settings: RescoringSettings) {
    let (app, stop) = (app.clone(), app.shutdown.clone());
    stop.clone().spawn(async move {
        rescoring::run(&app.store, &app.queue, &settings, app.clock.clone(), &stop).await;
    });
}

/// The worker pool of this service.
fn worker_pool(app: &App, settings: AnalysisSettings, program: Program) -> WorkerPool {
    WorkerPool {
        store: app.store.clone(),
        vault: app.vault.clone(),
        queue: app.queue.clone(),
        clock: app.clock.clone(),
        program,
        settings,
    }
}

/// Creates the first administrator if there is no account yet. Returns whether it did.
async fn make_first_administrator(store: &Store, data: &Path, password: &Password) -> anyhow::Result<bool> {
    if store.people().count().await? > 0 {
        return Ok(false);
    }
    let hash = password.hash();
    upkeep::write_password_file(data, ADMINISTRATOR, password, &hash)?;
    let administrator = NewPerson {
        login: ADMINISTRATOR.parse()?,
        name: "Administrator".parse()?,
        role: Role::Administrator,
        password: hash,
        password_state: PasswordState::ChangeInBrowser,
        trainee: None,
    };
    store.people().create(&Scope::service(), administrator).await?;
    Ok(true)
}

/// Prints the address.
fn print_welcome(running: &RunningService) {
    let scheme = if running.app.service_info.is_https { "https" } else { "http" };
    print_line(&format!("Trocar listens on {scheme}://{}{}/", running.address, running.app.settings.base_path));
    if let Some(address) = running.redirect_address {
        print_line(&format!("Requests to http://{address}/ are redirected to it."));
    }
}

/// The metrics of the process. All services in one process share them, as in tests.
fn metrics() -> anyhow::Result<PrometheusHandle> {
    static SHARED: Mutex<Option<PrometheusHandle>> = Mutex::new(None);
    let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    let handle = match shared.take() {
        Some(handle) => handle,
        None => PrometheusBuilder::new().install_recorder()?,
    };
    Ok(shared.insert(handle).clone())
}
