//! `trocar agent stand-by`: the agent as a service of the box.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{Context, anyhow};

use super::screen::{Screen, ScreenLanguage, ScreenSettings};
use super::send_unnamed::send_unnamed;
use super::{
    SPOOL_BYTES, camera_note_path, checked_server, hold_controls, key_value, restrict_new_files_to_owner, seconds,
    start_log,
};
use crate::capture::Agent;
use crate::capture::controls::{CameraDevice, restore_automatics};
use crate::capture::held_controls::HoldControls;
use crate::capture::source::OpenSource;
use crate::capture::spool::Spool;
use crate::capture::standby::camera::CameraKeeper;
use crate::capture::standby::unnamed::{FileOutcome, SendFile};
use crate::capture::standby::{Standby, StandbyParts};
use crate::commands::CommandFailure;
use crate::commands::upload::client::ServiceClient;
use crate::domain::box_agent::CHECK_IN_IDLE;
use crate::ids::FeedId;
use crate::media::CaptureSource;
use crate::shutdown::Shutdown;
use crate::time::{Clock, SharedClock, SystemClock};

/// Default silence after which the camera counts as missing, s: pages show it within ten seconds.
const CAMERA_SILENCE_S: f64 = 5.0;
/// Default time after which a recording ends whose camera is missing, s.
const CAMERA_OUTAGE_S: f64 = 60.0;
/// Default key of the screen that starts and stops.
const SCREEN_KEY: &str = "Space";

/// Arguments of `trocar agent stand-by`.
#[derive(clap::Args)]
pub(super) struct StandbyArgs {
    /// Address of the server, such as `https://trocar.example` or `http://127.0.0.1:8080`
    #[arg(long, value_name = "URL")]
    server: String,
    /// Id or code of the box that the camera belongs to
    #[arg(long = "box", value_name = "CODE")]
    in_box: String,
    /// File with the token of the box's agent
    #[arg(long, value_name = "FILE")]
    token_file: PathBuf,
    /// Folder for frames that the server does not have yet
    #[arg(long, value_name = "DIR", default_value = "trocar-spool")]
    spool: PathBuf,
    /// Limit of the spool, bytes; when it is full, the oldest frames are deleted [default: 17179869184, which are 16 GiB]
    #[arg(long, value_name = "N", default_value_t = SPOOL_BYTES, hide_default_value = true)]
    spool_bytes: u64,
    /// A camera that sends nothing for this many seconds is missing, and is opened again
    #[arg(long, value_name = "N", default_value_t = CAMERA_SILENCE_S)]
    silence_s: f64,
    /// End a recording if its camera is not back after this many seconds
    #[arg(long, value_name = "N", default_value_t = CAMERA_OUTAGE_S)]
    reconnect_s: f64,
    /// Serve the page for the box's own screen at this port of this computer, http://127.0.0.1:PORT/
    #[arg(long, value_name = "PORT")]
    screen: Option<u16>,
    /// Key on that page that starts and stops, such as Space, Enter, F9 or KeyB; a foot pedal is a keyboard with one key
    #[arg(long, value_name = "KEY", default_value = SCREEN_KEY, requires = "screen")]
    key: String,
    /// Language of that page; by default that of its browser
    #[arg(long, value_enum, requires = "screen")]
    language: Option<ScreenLanguage>,
    /// Make no recordings without a name: the button and the key do nothing until a trainee has checked in
    #[arg(long)]
    require_check_in: bool,
    /// Let the recording of a trainee who checks in begin by itself, with the first movement in the picture; the key starts
    /// the next one the same way
    #[arg(long)]
    start_on_movement: bool,
    /// Leave the camera's automatic exposure, gain and white balance switched on during recordings
    #[arg(long)]
    automatic: bool,
    /// FFmpeg option for the camera, such as video_size=1280x720; may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE", value_parser = key_value)]
    options: Vec<(String, String)>,
    /// Log filter, such as `info` or `trocar=debug`
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,
    /// Added to the clock of this computer, ms; for tests
    #[arg(long, hide = true, default_value_t = 0, allow_hyphen_values = true)]
    clock_offset_ms: i64,
    /// Camera (/dev/video0), file, or address that FFmpeg can open
    source: String,
}

/// Runs the command.
pub(super) fn run(args: StandbyArgs) -> Result<(), CommandFailure> {
    start_log(&args.log)?;
    restrict_new_files_to_owner();
    let server = checked_server(&args.server, &args.in_box, &args.token_file)?;
    let patience = (seconds("--silence-s", args.silence_s, 0.1)?, seconds("--reconnect-s", args.reconnect_s, 0.0)?);
    let spool = Spool::open(&args.spool, args.spool_bytes)
        .with_context(|| format!("opening the spool {}", args.spool.display()))
        .map_err(CommandFailure::Input)?;
    if let Err(error) = restore_automatics(&camera_note_path(&args.spool), CameraDevice::open) {
        tracing::warn!(%error, "cannot restore the automatic controls that an earlier run switched off at the camera");
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    let done = runtime.block_on(async {
        let shutdown = Shutdown::new();
        shutdown.begin_on_signals().context("listening for signals")?;
        let camera = CameraKeeper::new(opener(&args, &shutdown), patience.0, patience.1, false);
        let standby = Standby::new(StandbyParts {
            agent: Agent::new(spool),
            server,
            camera,
            spool: args.spool.clone(),
            clock: clock(args.clock_offset_ms),
            boot: boot_id(),
            hold_controls: is_camera(&args.source).then(|| controls(&args)),
            send_file: send_file(&args),
            requires_check_in: args.require_check_in,
            starts_on_movement: args.start_on_movement,
            movement_patience: CHECK_IN_IDLE, // as long as a check-in lasts without a recording
            shutdown: shutdown.clone(),
        });
        if let Some(port) = args.screen {
            let settings = ScreenSettings { port, key: args.key.clone(), language: args.language };
            let screen = Screen::bind(settings).await.map_err(|error| {
                CommandFailure::Input(anyhow!("--screen {port}: the page cannot be served there ({error})"))
            })?;
            tokio::spawn(screen.serve(standby.clone(), shutdown.clone()));
        }
        standby.run().await;
        Ok(())
    });
    runtime.shutdown_timeout(Duration::from_millis(500));
    done
}

/// Opens the camera, the first time and after each interruption.
fn opener(args: &StandbyArgs, shutdown: &Shutdown) -> OpenSource {
    let (address, options, ending) = (args.source.clone(), args.options.clone(), shutdown.clone());
    Arc::new(move |stop| {
        let ending = ending.clone();
        CaptureSource::open(&address, &options, move || stop.load(Ordering::Relaxed) || ending.is_begun())
    })
}

fn is_camera(source: &str) -> bool {
    use std::os::unix::fs::FileTypeExt;
    // A camera may be unplugged at the start: its path says what it is.
    std::fs::metadata(source).map_or(source.starts_with("/dev/"), |found| found.file_type().is_char_device())
}

/// Holds the camera's controls, unless they are to stay automatic.
fn controls(args: &StandbyArgs) -> HoldControls {
    match args.automatic {
        true => Arc::new(|_, _, _| Box::pin(async {})),
        false => hold_controls(&args.source, camera_note_path(&args.spool)),
    }
}

/// Sends recordings without a name, with the token of the box.
fn send_file(args: &StandbyArgs) -> SendFile {
    let (server, token_file) = (args.server.clone(), args.token_file.clone());
    Arc::new(move |file| {
        let (server, token_file) = (server.clone(), token_file.clone());
        Box::pin(async move {
            match ServiceClient::new(&server, &token_file) {
                Ok(client) => send_unnamed(&client, file).await,
                Err(why) => FileOutcome::Refused(why),
            }
        })
    })
}

/// Id of the computer's start. Where the kernel does not say it, each run of the agent counts as a start of its own.
fn boot_id() -> String {
    let known = std::fs::read_to_string("/proc/sys/kernel/random/boot_id");
    known.map_or_else(|_| FeedId::at(SystemClock.now_ms()).to_string(), |id| id.trim().to_owned())
}

/// The computer's clock, or one that is wrong by this much.
fn clock(offset_ms: i64) -> SharedClock {
    if offset_ms == 0 { Arc::new(SystemClock) } else { Arc::new(WrongClock { offset_ms }) }
}

/// A clock that is wrong, for tests.
#[derive(Debug)]
struct WrongClock {
    offset_ms: i64,
}

impl Clock for WrongClock {
    fn now_ms(&self) -> i64 {
        SystemClock.now_ms() + self.offset_ms
    }

    fn monotonic_ms(&self) -> i64 {
        SystemClock.monotonic_ms()
    }

    fn since_boot_ms(&self) -> i64 {
        SystemClock.since_boot_ms()
    }

    fn sleep(&self, duration: Duration) -> crate::time::Sleep {
        SystemClock.sleep(duration)
    }
}

/// Folder of the spool of the installed service.
pub(super) fn installed_spool() -> &'static Path {
    Path::new("/var/lib/trocar-agent")
}
