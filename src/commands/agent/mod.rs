//! `trocar agent`: runs beside a box. Records its camera, sends the recording meanwhile, and sends what earlier runs
//! left in the spool. `trocar agent stand-by` keeps the camera open and records at the word of the server.
//!
//! SIGINT or SIGTERM ends the recording. The agent then sends the rest until the server has the whole recording, or
//! until a second signal. Unsent frames stay in the spool. The exit status is 0 only if the server has the whole
//! recording and its source was not lost.

mod install;
mod screen;
mod send_unnamed;
mod standby;

use std::io::{IsTerminal, Write, stderr};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, anyhow};
use tokio::time::{interval, sleep};
use tracing_subscriber::EnvFilter;

use super::{CommandFailure, restrict_new_files_to_owner};
use crate::capture::connection::Server;
use crate::capture::controls::{CameraDevice, CameraLock, LockResult, restore_automatics};
use crate::capture::held_controls::{HoldControls, SourceControls};
use crate::capture::recorder::{RecordingRules, record};
use crate::capture::sender::{SendOutcome, send};
use crate::capture::source::{OpenSource, RecordedSource, SourcePatience};
use crate::capture::spool::{Spool, SpooledRecording};
use crate::capture::{Agent, status};
use crate::domain::feed::PROTOCOL;
use crate::domain::feed::messages::Hello;
use crate::ids::FeedId;
use crate::media::{CaptureSource, SourceInfo};
use crate::shutdown::Shutdown;
use crate::time::{Clock, SystemClock, to_rfc3339};

/// Default limit of the spool, bytes: an hour at 36 Mbit/s.
const SPOOL_BYTES: u64 = 16 << 30;
/// Interval of status lines in the log if stderr is not a terminal, s.
const LOG_INTERVAL_S: u64 = 10;
/// Default silence after which a source counts as interrupted, s.
const SOURCE_SILENCE_S: f64 = 30.0;
/// Default time after which an interrupted source is lost, s: a cable that slipped out is found by then.
const SOURCE_OUTAGE_S: f64 = 60.0;

/// Arguments of `trocar agent`.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct AgentArgs {
    #[command(subcommand)]
    command: Option<AgentSubcommand>,
    #[command(flatten)]
    record: Option<RecordArgs>,
}

#[derive(clap::Subcommand)]
enum AgentSubcommand {
    /// Keep the camera open, report the state of the box, and record when the server or the box's screen says so.
    StandBy(standby::StandbyArgs),
    /// Install the agent as a service of this computer that stands by.
    Install(install::InstallArgs),
    /// Remove the service that `install` made; the spool and the token stay.
    Uninstall(install::UninstallArgs),
}

/// Runs the command.
pub fn run(args: AgentArgs) -> Result<(), CommandFailure> {
    match (args.command, args.record) {
        (Some(AgentSubcommand::StandBy(args)), _) => standby::run(args),
        (Some(AgentSubcommand::Install(args)), _) => install::run(args),
        (Some(AgentSubcommand::Uninstall(args)), _) => install::uninstall(args),
        (None, Some(args)) => record_once(args),
        (None, None) => Err(CommandFailure::Input(anyhow!("name the server, the box and the token file; see --help"))),
    }
}

/// Arguments that record one session, or send what earlier runs left.
#[derive(clap::Args)]
struct RecordArgs {
    /// Address of the server, such as `https://trocar.example` or `http://127.0.0.1:8080`
    #[arg(long, value_name = "URL")]
    server: String,
    /// Id or code of the box that the camera belongs to
    #[arg(long = "box", value_name = "CODE")]
    in_box: String,
    /// File with the token of the box's agent
    #[arg(long, value_name = "FILE")]
    token_file: PathBuf,
    /// Id or code of the trainee; needed with a source
    #[arg(long, value_name = "ID", requires = "source")]
    trainee: Option<String>,
    /// Id or code of the task; needed with a source
    #[arg(long, value_name = "ID", requires = "source")]
    task: Option<String>,
    /// Folder for frames that the server does not have yet
    #[arg(long, value_name = "DIR", default_value = "trocar-spool")]
    spool: PathBuf,
    /// Limit of the spool, bytes; when it is full, the oldest frames are deleted [default: 17179869184, which are 16 GiB]
    #[arg(long, value_name = "N", default_value_t = SPOOL_BYTES, hide_default_value = true)]
    spool_bytes: u64,
    /// End the recording after this many seconds
    #[arg(long, value_name = "N")]
    seconds: Option<f64>,
    /// A camera or stream that sends nothing for this many seconds is opened again
    #[arg(long, value_name = "N", default_value_t = SOURCE_SILENCE_S)]
    silence_s: f64,
    /// End the recording if a camera or stream that ended, failed or fell silent is not back after this many seconds
    #[arg(long, value_name = "N", default_value_t = SOURCE_OUTAGE_S)]
    reconnect_s: f64,
    /// Read a file as fast as possible instead of in real time
    #[arg(long)]
    as_fast_as_possible: bool,
    /// Leave the camera's automatic exposure, gain and white balance switched on
    #[arg(long)]
    automatic: bool,
    /// FFmpeg option for the source, such as video_size=1280x720; may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE", value_parser = key_value)]
    options: Vec<(String, String)>,
    /// Log filter, such as `info` or `trocar=debug`
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,
    /// Camera (/dev/video0), file, or address that FFmpeg can open; without it, only the spool is sent
    #[arg(requires = "trainee", requires = "task")]
    source: Option<String>,
}

/// Records one session, and sends what earlier runs left.
fn record_once(args: RecordArgs) -> Result<(), CommandFailure> {
    start_log(&args.log)?;
    restrict_new_files_to_owner();
    let server = checked_server(&args.server, &args.in_box, &args.token_file)?;
    if args.seconds.is_some_and(|seconds| !(seconds.is_finite() && seconds > 0.0)) {
        return Err(CommandFailure::Input(anyhow!("--seconds: expected a number above 0")));
    }
    let patience = SourcePatience {
        silence: seconds("--silence-s", args.silence_s, 0.1)?,
        outage: seconds("--reconnect-s", args.reconnect_s, 0.0)?,
    };
    let spool = Spool::open(&args.spool, args.spool_bytes)
        .with_context(|| format!("opening the spool {}", args.spool.display()))
        .map_err(CommandFailure::Input)?;
    // Before the camera is opened, so that its automatic controls settle again.
    if let Err(error) = restore_automatics(&camera_note_path(&args.spool), CameraDevice::open) {
        tracing::warn!(%error, "cannot restore the automatic controls that an earlier run switched off at the camera");
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    let done = runtime.block_on(record_and_send_all(Agent::new(spool), server, args, patience));
    runtime.shutdown_timeout(Duration::from_millis(500));
    done
}

/// The server and the box, with warnings about what strangers could read.
fn checked_server(address: &str, in_box: &str, token_file: &Path) -> Result<Server, CommandFailure> {
    let server = Server::new(address, in_box, token_file).map_err(|why| CommandFailure::Input(anyhow!(why)))?;
    if server.is_unencrypted() {
        tracing::warn!("the connection is not encrypted; token and recording can be read on the way: use https");
    }
    if is_readable_by_others(token_file) {
        let file = token_file.display();
        tracing::warn!(%file, "all users of this machine can read the token; restrict the file with `chmod 600`");
    }
    Ok(server)
}

/// True if every user of the machine may read this file.
fn is_readable_by_others(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|found| found.permissions().mode() & 0o004 != 0)
}

/// A duration of the command line, from `min` s to a day.
fn seconds(flag: &str, value: f64, min: f64) -> Result<Duration, CommandFailure> {
    let duration = Duration::try_from_secs_f64(value).ok().filter(|_| (min..=86_400.0).contains(&value));
    duration.ok_or_else(|| CommandFailure::Input(anyhow!("{flag}: expected {min} to 86400 seconds")))
}

async fn record_and_send_all(
    agent: Agent,
    server: Server,
    args: RecordArgs,
    patience: SourcePatience,
) -> Result<(), CommandFailure> {
    let shutdown = Shutdown::new();
    shutdown.begin_on_signals().context("listening for signals")?;
    let left_over = agent.spool().ids();
    let status_lines = tokio::spawn(show_status(agent.clone()));
    let whole = match &args.source {
        Some(source) => record_and_send(&agent, &server, &args, (source, patience), &shutdown).await,
        None => Ok(()),
    };
    // With a source, the first signal only ends the recording; sending continues until a second signal ends the
    // process.
    let stop = if args.source.is_some() { Shutdown::new() } else { shutdown };
    let rest = send_left_over(&agent, &server, left_over, &stop).await;
    status_lines.abort();
    clear_line();
    match args.source {
        Some(_) => whole, // recordings of earlier runs that are refused are logged, but do not fail this run
        None => rest,
    }
}

/// Records a session, and sends it until the server has the whole recording.
async fn record_and_send(
    agent: &Agent,
    server: &Server,
    args: &RecordArgs,
    (address, patience): (&str, SourcePatience),
    shutdown: &Shutdown,
) -> Result<(), CommandFailure> {
    let source = RecordedSource::open(opener(address, args, shutdown), patience).await.context("opening the source")?;
    let mut source = source.with_context(|| format!("the source {address}")).map_err(CommandFailure::Input)?;
    let info = source.info().clone();
    log_source(&info);
    let id =
        agent.spool().begin(hello(args, &info), server.in_box()).context("beginning the recording in the spool")?;
    let is_paced = info.is_file && !args.as_fast_as_possible;
    let rules = RecordingRules {
        is_paced,
        seconds: args.seconds,
        time_base: info.time_base,
        first_arrived: None,
        holds_controls: info.is_camera && !args.automatic,
    };
    // Ends with the signal, with the source, or when the server refuses the recording.
    let recording = Shutdown::new();
    let (recorder, ending) = (agent.clone(), recording.clone());
    let controls = rules
        .holds_controls
        .then(|| SourceControls::hold(&mut source, hold_controls(address, camera_note_path(&args.spool))));
    let recorder = tokio::spawn(async move {
        let ended = record(&recorder, source, rules, &ending).await;
        ending.begin();
        if let Some(controls) = controls {
            controls.end().await; // the camera may be used while the rest is sent
        }
        tracing::info!(frames = ended.frames, "recording ended");
        ended
    });
    let (stop, signal) = (recording.clone(), shutdown.begun());
    tokio::spawn(async move {
        signal.await;
        stop.begin();
    });
    let outcome = send(agent, server, id).await;
    if matches!(outcome, SendOutcome::Refused(_)) && !agent.status().was_welcome() {
        recording.begin(); // the server never accepted it and never will: stop now, so that the user sees the error
    }
    let source_lost = recorder.await.context("recording")?.source_lost;
    match outcome {
        SendOutcome::Complete(session) => {
            tracing::info!(%session, "recording complete on the server");
            match source_lost {
                None => Ok(()),
                Some(why) => Err(CommandFailure::Failed(anyhow!(
                    "{why}; the recording ended there, and the server has what was recorded until then"
                ))),
            }
        }
        SendOutcome::Empty => Err(CommandFailure::Failed(anyhow!("the source delivered no frame"))),
        SendOutcome::Refused(why) => Err(CommandFailure::Failed(anyhow!(why))),
    }
}

/// Opens the source, the first time and after each interruption.
fn opener(address: &str, args: &RecordArgs, shutdown: &Shutdown) -> OpenSource {
    let (address, options, ending) = (address.to_owned(), args.options.clone(), shutdown.clone());
    Arc::new(move |stop| {
        let ending = ending.clone();
        CaptureSource::open(&address, &options, move || stop.load(Ordering::Relaxed) || ending.is_begun())
    })
}

/// Sends the recordings that earlier runs left in the spool, the oldest first: a box sends one recording at a time.
async fn send_left_over(
    agent: &Agent,
    server: &Server,
    ids: Vec<FeedId>,
    stop: &Shutdown,
) -> Result<(), CommandFailure> {
    let mut refused = Vec::new();
    for id in ids {
        if agent.spool().get(id).is_some_and(SpooledRecording::is_unnamed) {
            tracing::warn!(recording = %id, "a recording without a name stays here: `trocar agent stand-by` sends it");
            continue;
        }
        tracing::info!(recording = %id, "sending a recording of an earlier run");
        tokio::select! {
            outcome = send(agent, server, id) => match outcome {
                SendOutcome::Complete(session) => tracing::info!(%session, "recording complete on the server"),
                SendOutcome::Empty => {}
                SendOutcome::Refused(why) => refused.push(why),
            },
            () = stop.begun() => {
                let why = anyhow!("ended by a signal; unsent frames stay in the spool");
                return Err(CommandFailure::Failed(why));
            }
        }
    }
    if refused.is_empty() { Ok(()) } else { Err(CommandFailure::Failed(anyhow!(refused.join("; ")))) }
}

fn hello(args: &RecordArgs, info: &SourceInfo) -> Hello {
    let now_ms = SystemClock.now_ms();
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
        resumes: true,
    }
}

fn log_source(info: &SourceInfo) {
    let ((width, height), codec) = (info.size, info.codec.name());
    tracing::info!(width, height, codec, "capturing");
    if let Some(from) = &info.coded_from {
        tracing::warn!(
            from,
            "the source's codec cannot be sent; frames are re-encoded as JPEG. A camera with H.264 or MJPEG avoids this"
        );
    }
}

/// Path of the note that records which controls were switched off at which camera.
fn camera_note_path(spool: &Path) -> PathBuf {
    spool.join("camera.json")
}

/// Holds the controls of a camera, and notes in this file what was switched off.
fn hold_controls(camera: &str, note: PathBuf) -> HoldControls {
    let camera = camera.to_owned();
    Arc::new(move |recording, settle, is_held| {
        Box::pin(lock_controls(camera.clone(), note.clone(), recording, (settle, is_held)))
    })
}

/// Waits for the camera's exposure and white balance to settle, then locks them until the recording ends. The flag is true
/// while they are locked.
async fn lock_controls(
    camera: String,
    note: PathBuf,
    recording: Shutdown,
    (settle, is_held): (Duration, Arc<AtomicBool>),
) {
    tokio::select! {
        () = recording.begun() => return,
        () = sleep(settle) => {}
    }
    let held = camera.clone();
    let held = tokio::task::spawn_blocking(move || {
        let path = Path::new(&held);
        CameraDevice::open(path).map(|controls| CameraLock::new(controls, path, &note))
    });
    let held = held.await;
    let _lock = match held {
        Ok(Ok((lock, controls))) => {
            controls.iter().for_each(|(name, locked)| log_control(&camera, name, locked));
            let is_refused = controls.iter().any(|(_, locked)| matches!(locked, LockResult::Refused(_)));
            is_held.store(!is_refused, Ordering::Release);
            lock
        }
        Ok(Err(error)) => {
            return tracing::warn!(%error, "cannot open the camera's controls: {}", manual_control_hint(&camera));
        }
        Err(error) => return tracing::error!(%error, "locking the camera's controls failed"),
    };
    recording.begun().await;
    is_held.store(false, Ordering::Release);
}

fn log_control(camera: &str, name: &str, locked: &LockResult) {
    match locked {
        LockResult::Off(value) => {
            tracing::info!(value, "automatic {name} switched off during the recording; its last value stays")
        }
        LockResult::WasOff => tracing::info!("automatic {name} was off already"),
        LockResult::Absent => tracing::info!("the camera has no switch for automatic {name}"),
        LockResult::Refused(error) => {
            tracing::warn!(%error, "cannot switch automatic {name} off: {}", manual_control_hint(camera))
        }
    }
}

fn manual_control_hint(camera: &str) -> String {
    format!(
        "the tapes' colours will change during the recording; set it by hand, `v4l2-ctl -d {camera} -L` lists the \
         controls"
    )
}

/// Shows the status: every second on a terminal, else every [`LOG_INTERVAL_S`] in the log.
async fn show_status(agent: Agent) {
    let mut seconds = interval(Duration::from_secs(1));
    let mut past: u64 = 0;
    loop {
        seconds.tick().await;
        past += 1;
        if stderr().is_terminal() {
            let line: String = status::line(&agent).chars().take(terminal_width()).collect();
            let _ = write!(stderr(), "\r\x1b[2K{line}"); // a closed terminal is no error
        } else if past.is_multiple_of(LOG_INTERVAL_S) {
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

/// Starts the log on stderr. Each entry replaces the status line on the terminal.
fn start_log(filter: &str) -> Result<(), CommandFailure> {
    let filter =
        EnvFilter::try_new(filter).with_context(|| format!("--log {filter}")).map_err(CommandFailure::input)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_that_every_user_of_the_machine_can_read_is_noticed() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for (mode, is_open) in [(0o600, false), (0o640, false), (0o644, true)] {
            std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(mode)).unwrap();
            assert_eq!(is_readable_by_others(file.path()), is_open, "{mode:o}");
        }
    }
}
