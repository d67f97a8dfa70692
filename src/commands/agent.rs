//! `trocar agent`: the box's own program. Sends what a camera sees while it is recorded, and what earlier runs could not.
//!
//! SIGINT or SIGTERM ends the recording; the agent then waits until it is whole on the server, or for a second signal. What
//! has not been sent stays in the spool. The status is 0 only when the recording is whole.

use std::io::{IsTerminal, Write, stderr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, anyhow};
use tokio::time::{interval, sleep};
use tracing_subscriber::EnvFilter;

use super::{Failure, keep_to_ourselves};
use crate::capture::connection::Server;
use crate::capture::controls::{Camera, Lock, Locked, give_back};
use crate::capture::recorder::{Rules, frames_of, record};
use crate::capture::sender::{Outcome, send};
use crate::capture::spool::Spool;
use crate::capture::{Agent, status};
use crate::domain::feed::PROTOCOL;
use crate::domain::feed::words::Hello;
use crate::ids::FeedId;
use crate::media::{Source, SourceInfo};
use crate::shutdown::Shutdown;
use crate::time::{Clock, System, to_rfc3339};

/// Usual limit of a spool, bytes: an hour at 36 Mbit/s.
const SPOOL_BYTES: u64 = 16 << 30;
/// How often a line tells how it stands where nobody looks at it all the time.
const LOG_EVERY_S: u64 = 10;
/// How long a camera may look for its exposure and white balance before they are held.
const SETTLES: Duration = Duration::from_secs(2);

/// Arguments of `trocar agent`.
#[derive(clap::Args)]
pub struct Args {
    /// The server, as `https://trocar.example` or `http://127.0.0.1:8080`
    #[arg(long, value_name = "URL")]
    server: String,
    /// Id or code of the box that the camera belongs to
    #[arg(long = "box", value_name = "CODE")]
    in_box: String,
    /// File that holds the token of the box's agent
    #[arg(long, value_name = "FILE")]
    token_file: PathBuf,
    /// Who trains, by id or code
    #[arg(long, value_name = "ID", requires = "source")]
    trainee: Option<String>,
    /// What they do, by id or code
    #[arg(long, value_name = "ID", requires = "source")]
    task: Option<String>,
    /// Folder of what the server does not have yet
    #[arg(long, value_name = "DIR", default_value = "trocar-spool")]
    spool: PathBuf,
    /// What the spool may hold, bytes; beyond it the oldest frames go
    #[arg(long, value_name = "N", default_value_t = SPOOL_BYTES)]
    spool_bytes: u64,
    /// End the recording after so many seconds
    #[arg(long, value_name = "N")]
    seconds: Option<f64>,
    /// Read a file as fast as the spool takes it, not at the times that its frames bear
    #[arg(long)]
    as_fast_as_possible: bool,
    /// Leave a camera's exposure, gain and white balance to the camera
    #[arg(long)]
    automatic: bool,
    /// An option of FFmpeg's for the source, as video_size=1280x720; may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE", value_parser = key_value)]
    options: Vec<(String, String)>,
    /// What to log, as `info` or `trocar=debug`
    #[arg(long, default_value = "info")]
    log: String,
    /// A camera (/dev/video0), a file, or an address that FFmpeg opens; without it what lies in the spool is sent
    #[arg(requires = "trainee", requires = "task")]
    source: Option<String>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    start_log(&args.log)?;
    keep_to_ourselves();
    let server =
        Server::new(&args.server, &args.in_box, &args.token_file).map_err(|why| Failure::Input(anyhow!(why)))?;
    if server.is_open_to_all() {
        tracing::warn!("the token and the recording travel in the clear: give the server TLS, and say https");
    }
    if args.seconds.is_some_and(|seconds| !(seconds.is_finite() && seconds > 0.0)) {
        return Err(Failure::Input(anyhow!("--seconds: expected more than 0")));
    }
    let spool = Spool::open(&args.spool, args.spool_bytes)
        .with_context(|| format!("opening the spool {}", args.spool.display()))
        .map_err(Failure::Input)?;
    // Before the camera is opened, so that it finds its values anew.
    if let Err(error) = give_back(&note_in(&args.spool), Camera::open) {
        tracing::warn!(%error, "what an earlier run switched off at its camera cannot be switched on again");
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    let done = runtime.block_on(work(Agent::new(spool), server, args));
    runtime.shutdown_timeout(Duration::from_millis(500));
    done
}

async fn work(agent: Agent, server: Server, args: Args) -> Result<(), Failure> {
    let shutdown = Shutdown::new();
    shutdown.begin_on_signals().context("listening for signals")?;
    let left_over = agent.spool().ids();
    let tell = tokio::spawn(keep_telling(agent.clone()));
    let whole = match &args.source {
        Some(source) => record_and_send(&agent, &server, &args, source, &shutdown).await,
        None => Ok(()),
    };
    // A signal ends the recording, as it ends every one of a camera; it is a second one that ends the sending.
    let stop = if args.source.is_some() { Shutdown::new() } else { shutdown };
    let rest = send_left_over(&agent, &server, left_over, &stop).await;
    tell.abort();
    clear_line();
    match args.source {
        Some(_) => whole, // what is left of earlier runs was told of, and is no failure of this one
        None => rest,
    }
}

/// Records a session, and sends it until it is whole.
async fn record_and_send(
    agent: &Agent,
    server: &Server,
    args: &Args,
    address: &str,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let over = Arc::new(AtomicBool::new(false));
    let (opened, options, is_over) = (address.to_owned(), args.options.clone(), over.clone());
    let ending = shutdown.clone();
    let is_over = move || is_over.load(Ordering::Relaxed) || ending.is_begun();
    let source = tokio::task::spawn_blocking(move || Source::open(&opened, &options, is_over));
    let source = source.await.context("opening the source")?;
    let source = source.with_context(|| format!("the source {address}")).map_err(Failure::Input)?;
    let info = source.info().clone();
    say_what_it_is(&info);
    let id =
        agent.spool().begin(hello(args, &info), server.in_box()).context("beginning the recording in the spool")?;
    let is_paced = info.is_file && !args.as_fast_as_possible;
    let rules = Rules { is_paced, seconds: args.seconds, time_base: info.time_base };
    // Ends with the signal, when nobody will ever take the recording, and with the source.
    let recording = Shutdown::new();
    let (recorder, ending) = (agent.clone(), recording.clone());
    let holding = (info.is_camera && !args.automatic)
        .then(|| tokio::spawn(hold(address.to_owned(), note_in(&args.spool), recording.clone())));
    let frames = frames_of(source);
    let recorder = tokio::spawn(async move {
        let frames = record(&recorder, frames, rules, &ending).await;
        over.store(true, Ordering::Relaxed);
        ending.begin();
        tracing::info!(frames, "the recording has ended");
    });
    let (stop, asked) = (recording.clone(), shutdown.begun());
    tokio::spawn(async move {
        asked.await;
        stop.begin();
    });
    let outcome = send(agent, server, id).await;
    if matches!(outcome, Outcome::Refused(_)) && !agent.status().was_welcome {
        recording.begin(); // it never was, and will not be: somebody must hear of it now
    }
    recorder.await.context("recording")?;
    if let Some(holding) = holding {
        let _ = holding.await; // a panic is logged where it happened
    }
    match outcome {
        Outcome::Whole(session) => {
            tracing::info!(%session, "the recording is whole");
            Ok(())
        }
        Outcome::Empty => Err(Failure::Failed(anyhow!("the source gave no frame"))),
        Outcome::Refused(why) => Err(Failure::Failed(anyhow!(why))),
    }
}

/// Sends what earlier runs left, the oldest first: a box sends one recording at a time.
async fn send_left_over(agent: &Agent, server: &Server, ids: Vec<FeedId>, stop: &Shutdown) -> Result<(), Failure> {
    let mut refused = Vec::new();
    for id in ids {
        tracing::info!(recording = %id, "sending what an earlier run left");
        tokio::select! {
            outcome = send(agent, server, id) => match outcome {
                Outcome::Whole(session) => tracing::info!(%session, "the recording is whole"),
                Outcome::Empty => {}
                Outcome::Refused(why) => refused.push(why),
            },
            () = stop.begun() => return Err(Failure::Failed(anyhow!("ended by a signal; the rest stays in the spool"))),
        }
    }
    if refused.is_empty() { Ok(()) } else { Err(Failure::Failed(anyhow!(refused.join("; ")))) }
}

fn hello(args: &Args, info: &SourceInfo) -> Hello {
    let now_ms = System.now_ms();
    Hello {
        protocol: PROTOCOL,
        recording: FeedId::at(now_ms),
        trainee: args.trainee.clone().unwrap_or_default(),
        task: args.task.clone().unwrap_or_default(),
        codec: info.codec,
        width: info.size.0,
        height: info.size.1,
        time_base: info.time_base,
        began_at: to_rfc3339(now_ms),
        sender: concat!("trocar agent ", env!("CARGO_PKG_VERSION")).to_owned(),
    }
}

fn say_what_it_is(info: &SourceInfo) {
    let ((width, height), codec) = (info.size, info.codec.name());
    tracing::info!(width, height, codec, "capturing");
    if let Some(from) = &info.coded_from {
        tracing::warn!(
            from,
            "frames are decoded and coded anew as JPEGs: a camera that gives H.264 or MJPEG saves that"
        );
    }
}

/// Where it is noted what is switched off at a camera.
fn note_in(spool: &Path) -> PathBuf {
    spool.join("camera.json")
}

/// Once the camera has found its exposure and white balance, keeps them as they are until the recording ends.
async fn hold(camera: String, note: PathBuf, recording: Shutdown) {
    tokio::select! {
        () = recording.begun() => return,
        () = sleep(SETTLES) => {}
    }
    let held = camera.clone();
    let held = tokio::task::spawn_blocking(move || {
        let path = Path::new(&held);
        Camera::open(path).map(|controls| Lock::new(controls, path, &note))
    });
    let held = held.await;
    let _lock = match held {
        Ok(Ok((lock, told))) => {
            told.iter().for_each(|(name, locked)| tell(&camera, name, locked));
            lock
        }
        Ok(Err(error)) => return tracing::warn!(%error, "the camera's controls cannot be opened: {}", by_hand(&camera)),
        Err(error) => return tracing::error!(%error, "the camera's controls"),
    };
    recording.begun().await;
}

fn tell(camera: &str, name: &str, locked: &Locked) {
    match locked {
        Locked::Off(value) => {
            tracing::info!(value, "automatic {name} is off while this is recorded, at what it had found")
        }
        Locked::WasOff => tracing::info!("automatic {name} was off already"),
        Locked::Absent => tracing::info!("the camera has no switch for automatic {name}"),
        Locked::Refused(error) => tracing::warn!(%error, "automatic {name} cannot be held: {}", by_hand(camera)),
    }
}

fn by_hand(camera: &str) -> String {
    format!(
        "it changes the tapes' colours while somebody trains; see `v4l2-ctl -d {camera} -L` for what can be set by hand"
    )
}

/// Tells once a second on a terminal, else now and then in the log.
async fn keep_telling(agent: Agent) {
    let mut seconds = interval(Duration::from_secs(1));
    let mut past: u64 = 0;
    loop {
        seconds.tick().await;
        past += 1;
        if stderr().is_terminal() {
            let line: String = status::line(&agent).chars().take(terminal_width()).collect();
            let _ = write!(stderr(), "\r\x1b[2K{line}"); // a terminal that is gone is told nothing
        } else if past.is_multiple_of(LOG_EVERY_S) {
            tracing::info!("{}", status::line(&agent));
        }
    }
}

fn terminal_width() -> usize {
    rustix::termios::tcgetwinsize(stderr()).map_or(80, |size| usize::from(size.ws_col).max(20))
}

fn clear_line() {
    if stderr().is_terminal() {
        let _ = write!(stderr(), "\r\x1b[2K"); // as above
    }
}

/// Logs go to stderr, over the line that is there.
fn start_log(filter: &str) -> Result<(), Failure> {
    let filter = EnvFilter::try_new(filter).with_context(|| format!("--log {filter}")).map_err(Failure::input)?;
    let writer = || {
        clear_line();
        stderr()
    };
    let on_a_terminal = stderr().is_terminal();
    tracing_subscriber::fmt().with_env_filter(filter).with_ansi(on_a_terminal).with_writer(writer).init();
    Ok(())
}

fn key_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected KEY=VALUE")?;
    Ok((key.to_owned(), value.to_owned()))
}
