//! `trocar serve`: the whole service: HTTP, dashboard, queue and workers.
//!
//! The first start creates the data folder, the schema and an administrator, and prints the address and a password
//! once. Every start makes files and database consistent before it listens. SIGTERM and SIGINT end the service within
//! ten seconds: open requests finish, partial uploads are kept, leases are released.

use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::task::JoinHandle;
use tracing_subscriber::EnvFilter;

use super::demonstration::{self, Builder};
use super::{Failure, keep_to_ourselves};
use crate::analysis::{AnalysisSettings, Glances, Workshop};
use crate::cohorts::Cohorts;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::Password;
use crate::events::Events;
use crate::http::auth::throttle::Throttle;
use crate::http::places::Places;
use crate::http::state::{App, InForce, Parts};
use crate::http::{router, server};
use crate::intake::Intake;
use crate::live::{self, Feeds, OpenFeeds};
use crate::pipeline::PIPELINE_VERSION;
use crate::queue::Queue;
use crate::rescoring::{self, RescoringSettings};
use crate::sandbox::{self, Program};
use crate::settings::{Flags, Settings, UpkeepSettings};
use crate::shutdown::Shutdown;
use crate::store::{NewPerson, Store};
use crate::time::{SharedClock, System};
use crate::upkeep;
use crate::vault::{Lock, Vault};

/// Time for all tasks to end after the shutdown began.
const GRACE: Duration = Duration::from_secs(9);
/// Requested limit of open files. The system's hard limit may be lower.
const DESCRIPTORS: u64 = 65_536;
/// Login of the first administrator.
const ADMINISTRATOR: &str = "administrator";

/// Arguments of `trocar serve`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for database, recordings and results; the first start creates it [default: trocar-data]
    #[arg(long)]
    data: Option<PathBuf>,
    /// Address to listen on [default: 127.0.0.1:8080]
    #[arg(long)]
    listen: Option<SocketAddr>,
    /// Number of recordings tracked at the same time [default: half the cores]
    #[arg(long)]
    workers: Option<usize>,
    /// Fill a new data folder with a demonstration: a simulated box, trainees and recordings
    #[arg(long)]
    demo: bool,
    /// Settings file [default: trocar.toml in the data folder]
    #[arg(long)]
    settings: Option<PathBuf>,
    /// Log filter, such as `info` or `trocar=debug`
    #[arg(long, env = "TROCAR_LOG", default_value = "info")]
    log: String,
    /// Write the log as JSON, one object per line
    #[arg(long)]
    log_json: bool,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    start_log(&args.log, args.log_json)?;
    let flags = Flags { settings: args.settings, data: args.data, listen: args.listen, workers: args.workers };
    let mut settings = Settings::load(flags).map_err(Failure::input)?;
    settings.workers = workers(settings.workers);
    keep_to_ourselves();
    // Each connection needs a file descriptor, and the usual soft limit is below `http.max_connections`.
    if let Err(error) = rlimit::increase_nofile_limit(DESCRIPTORS) {
        tracing::warn!(%error, "cannot raise the limit of open files; many connections may fail");
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    let served = runtime.block_on(serve(settings, args.demo));
    runtime.shutdown_timeout(Duration::from_millis(500));
    Ok(served?)
}

/// Starts the log on stderr: stdout is for the address and the first password.
fn start_log(filter: &str, json: bool) -> Result<(), Failure> {
    let filter = EnvFilter::try_new(filter).with_context(|| format!("--log {filter}")).map_err(Failure::input)?;
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    if json {
        log.json().init()
    } else {
        log.init()
    }
    Ok(())
}

async fn serve(settings: Settings, demo: bool) -> anyhow::Result<()> {
    let password = Password::random();
    let scratch = settings.data.join("demonstration");
    let running = start(settings, Arc::new(System), &password, Workshop::this_program()).await?;
    running.shutdown.begin_on_signals().context("listening for signals")?;
    greet(running.address, running.is_first.then_some(&password));
    if demo {
        demonstrate(&running, scratch).await.context("registering the demonstration centre")?;
    }
    running.ended().await;
    Ok(())
}

/// The number of workers for a setting. 0 means half the cores, because a recording keeps about two cores busy.
fn workers(set: usize) -> usize {
    match set {
        0 => std::thread::available_parallelism().map_or(1, |cores| cores.get().div_ceil(2)),
        some => some,
    }
}

/// Fills a new data folder with the demonstration centre, or continues where an earlier start stopped. Does nothing in
/// a data folder that is in real use.
async fn demonstrate(running: &Running, scratch: PathBuf) -> anyhow::Result<()> {
    let builder = Builder::new(&running.app, scratch);
    if !running.is_first && !builder.is_registered().await? {
        say("This data folder is already in use, so no demonstration is added. Use --demo with a new data folder.");
        return Ok(());
    }
    if let Some(password) = builder.register().await? {
        let instructor = demonstration::INSTRUCTOR;
        say(&format!("To see the demonstration, sign in as {instructor} with the password {}", password.reveal()));
    }
    running.shutdown.spawn(builder.fill(running.shutdown.clone()));
    Ok(())
}

/// A running service.
pub struct Running {
    /// Address that it listens on.
    pub address: SocketAddr,
    /// Its shutdown.
    pub shutdown: Shutdown,
    /// True if this start created the first administrator, with the given password.
    pub is_first: bool,
    app: App,
    served: JoinHandle<()>,
    _lock: Lock,
}

impl Running {
    /// Waits until the shutdown has begun and the service has ended.
    pub async fn ended(self) {
        // Both at once, so that open requests and background tasks share the same grace time.
        let (served, finished) = tokio::join!(self.served, self.shutdown.finished(GRACE));
        if served.is_err() {
            tracing::error!("accept loop panicked");
        }
        if !finished {
            tracing::warn!("some tasks did not end in time; the next start recovers them");
        }
    }

    /// Ends the service.
    pub async fn stop(self) {
        self.shutdown.begin();
        self.ended().await;
    }
}

/// Starts a service: recovers the data, listens, and starts the workers. `password` is for the first administrator, who
/// is created if there is no account yet. `child` is the program for child processes: this program, except in tests.
pub async fn start(
    settings: Settings,
    clock: SharedClock,
    password: &Password,
    child: Program,
) -> anyhow::Result<Running> {
    check_kernel(settings.analysis.require_landlock)?;
    let vault = Vault::open(&settings.data).await.context("opening the data folder")?;
    let lock = vault.lock().await.with_context(|| format!("using {}", settings.data.display()))?;
    let store =
        Store::open(&settings.database(), &settings.store, clock.clone()).await.context("opening the database")?;
    let recovered = upkeep::recover(&store, &vault).await.context("recovering")?;
    tracing::info!(?recovered, "recovered");
    let events = Events::new();
    let queue = Queue::new(store.clone(), settings.queue.clone(), events.clone(), clock.clone());
    queue.recover().await.context("recovering the queue")?;
    let is_first = make_first_administrator(&store, password).await.context("making the first administrator")?;
    let listener =
        TcpListener::bind(settings.listen).await.with_context(|| format!("listening on {}", settings.listen))?;
    let address = listener.local_addr().context("asking for the address")?;
    let shutdown = Shutdown::new();
    let (storage, jobs) = ((store.clone(), vault.clone()), (queue.clone(), events.clone()));
    let intake = Intake::new(storage, jobs, clock.clone(), shutdown.clone(), settings.uploads.clone());
    let feeds = Feeds::new(live::Parts {
        store: store.clone(),
        vault: vault.clone(),
        queue: queue.clone(),
        events: events.clone(),
        clock: clock.clone(),
        shutdown: shutdown.clone(),
        settings: settings.live.clone(),
        analysis: settings.analysis.clone(),
        program: child.clone(),
        open: OpenFeeds::default(),
        turns: Arc::default(),
    });
    let parts = Parts {
        throttle: Throttle::new(settings.http.attempts_per_min, clock.clone()),
        streams: Places::new(settings.http.max_event_streams, settings.http.max_event_streams_of_one),
        metrics: metrics().context("starting the metrics")?,
        settings: settings.http.clone(),
        in_force: in_force(&settings, clock.now_ms()),
        shutdown: shutdown.clone(),
        cohorts: Cohorts::new(store.clone(), clock.clone()),
        glances: Glances::new(vault.clone(), child.clone(), settings.analysis.clone(), clock.clone(), shutdown.clone()),
        store,
        vault,
        intake,
        feeds,
        feed_places: Arc::new(Semaphore::new(settings.live.max_feeds)),
        queue,
        events,
        clock,
    };
    let app = App::new(parts);
    keep_up(&app, &settings.upkeep);
    keep_rescoring(&app, settings.rescoring);
    workshop(&app, settings.analysis, child).open(settings.workers, &shutdown);
    let (http, stop, routes) = (settings.http, shutdown.clone(), router::routes(app.clone()));
    let served = tokio::spawn(async move { server::serve(listener, routes, &http, &stop).await });
    Ok(Running { address, shutdown, is_first, app, served, _lock: lock })
}

/// The facts and settings that the service reports to administrators.
fn in_force(settings: &Settings, started_at_ms: i64) -> InForce {
    InForce {
        pipeline: PIPELINE_VERSION,
        started_at_ms,
        workers: settings.workers,
        max_upload_bytes: settings.uploads.max_bytes,
        unfinished_upload_h: settings.uploads.expire_h,
        erased_within_s: settings.upkeep.collect_s,
    }
}

/// Refuses to start on a kernel that cannot confine child processes as the settings require.
fn check_kernel(require_landlock: bool) -> anyhow::Result<()> {
    match sandbox::landlock() {
        Ok(_) => {}
        Err(why) if require_landlock => anyhow::bail!(
            "{why}; or set `require_landlock = false` under [analysis]: child processes are then confined only by limits \
             and the system call filter"
        ),
        Err(why) => tracing::warn!(%why, "child processes are confined only by limits and the system call filter"),
    }
    Ok(())
}

/// Starts the background tasks: rescue of expired leases, upkeep of feeds, removal of unneeded files.
fn keep_up(app: &App, settings: &UpkeepSettings) {
    let (queue, stop) = (app.queue.clone(), app.shutdown.clone());
    app.shutdown.spawn(async move { queue.keep_sweeping(&stop).await });
    let feeds = app.feeds.clone();
    app.shutdown.spawn(async move { feeds.keep().await });
    let (app, every) = (app.clone(), Duration::from_secs(settings.collect_s.max(1)));
    let stop = app.shutdown.clone();
    stop.clone().spawn(async move { upkeep::keep(&app.store, &app.vault, every, app.clock.clone(), &stop).await });
}

/// Starts the background task that carries out rescoring orders.
fn keep_rescoring(app: &App, settings: RescoringSettings) {
    let (app, stop) = (app.clone(), app.shutdown.clone());
    stop.clone().spawn(async move {
        rescoring::keep(&app.store, &app.queue, &settings, app.clock.clone(), &stop).await;
    });
}

/// The worker pool of this service.
fn workshop(app: &App, settings: AnalysisSettings, program: Program) -> Workshop {
    Workshop {
        store: app.store.clone(),
        vault: app.vault.clone(),
        queue: app.queue.clone(),
        clock: app.clock.clone(),
        program,
        settings,
    }
}

/// Creates the first administrator if there is no account yet. Returns whether it did.
async fn make_first_administrator(store: &Store, password: &Password) -> anyhow::Result<bool> {
    if store.people().count().await? > 0 {
        return Ok(false);
    }
    let administrator = NewPerson {
        login: ADMINISTRATOR.parse()?,
        name: "Administrator".parse()?,
        role: Role::Administrator,
        password: password.hash(),
        trainee: None,
    };
    store.people().create(&Scope::service(), administrator).await?;
    Ok(true)
}

/// Prints the address and, at the first start, how to sign in.
fn greet(address: SocketAddr, password: Option<&Password>) {
    say(&format!("Trocar listens on http://{address}/"));
    if let Some(password) = password {
        say(&format!("Sign in as {ADMINISTRATOR} with the password {}", password.reveal()));
        say("The password is shown only this once and kept nowhere: change it after you have signed in.");
    }
}

/// Prints a line to stdout only, because a log would keep the password. If stdout is closed (`trocar serve | head -1`),
/// `println!` would panic; this function only warns.
fn say(line: &str) {
    let mut out = std::io::stdout().lock();
    if let Err(error) = writeln!(out, "{line}").and_then(|()| out.flush()) {
        tracing::warn!(%error, "cannot write to standard output; a message was lost");
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
