//! `trocar upload`: sends a folder of old recordings to a running service, each to the trainee, task, box and time that a
//! map says.
//!
//! Without `--send` nothing is sent: the command shows what would happen, and every problem at once. It can be ended at any
//! moment and run again: the service takes each recording once, and unfinished uploads continue where they stopped.

pub(super) mod client;
mod directory;
mod files;
mod journal;
mod plan;
mod send;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use jiff::tz::TimeZone;
use tracing_subscriber::EnvFilter;

use self::client::{RequestError, ServiceClient};
use self::directory::Directory;
use self::files::find_files;
use self::journal::Journal;
use self::plan::{
    Fate, MapDefaults, MappedFile, PlannedRecording, WhenRecorded, assign, mark_copies, mark_there, shown_time,
};
use self::send::{Arrived, send};
use super::progress::Meter;
use super::table::TextTable;
use super::{CommandFailure, print_result, restrict_new_files_to_owner};
use crate::domain::text::count_of;
use crate::intake::folder::{RecordedAt, RecordingMap};

/// Arguments of `trocar upload`.
#[derive(clap::Args)]
pub struct UploadArgs {
    /// Folder of the recordings; its folders are read, too
    folder: PathBuf,
    /// CSV table with the columns file, trainee, task, box and recorded_at
    #[arg(long, value_name = "FILE")]
    map: PathBuf,
    /// Address of the server, such as `https://trocar.example` or `http://127.0.0.1:8080`
    #[arg(long, value_name = "URL")]
    server: String,
    /// File with a token of an instructor or administrator
    #[arg(long, value_name = "FILE")]
    token_file: PathBuf,
    /// Send the recordings; without it, the command only shows what would happen
    #[arg(long)]
    send: bool,
    /// Task of the rows that name none, by code or name
    #[arg(long, value_name = "TASK")]
    task: Option<String>,
    /// Box of the rows that name none, by code or name
    #[arg(long = "box", value_name = "BOX")]
    in_box: Option<String>,
    /// Time zone of times without one, such as Europe/Berlin [default: that of this machine]
    #[arg(long, value_name = "ZONE")]
    time_zone: Option<String>,
    /// File for what is known of earlier runs [default: the map's name with .progress]
    #[arg(long, value_name = "FILE")]
    progress: Option<PathBuf>,
    /// No progress on stderr
    #[arg(long)]
    quiet: bool,
    /// Log filter, such as `warn` or `trocar=debug`
    #[arg(long, value_name = "FILTER", default_value = "warn")]
    log: String,
}

/// What the command found out before it sends anything.
#[derive(Default)]
struct UploadPlan {
    recordings: Vec<PlannedRecording>,
    left_out: Vec<String>,
    problems: Vec<String>,
}

/// Runs the command.
pub fn run(args: UploadArgs) -> Result<(), CommandFailure> {
    let filter = EnvFilter::try_new(&args.log).context("--log").map_err(CommandFailure::Input)?;
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    restrict_new_files_to_owner();
    let zone = match &args.time_zone {
        Some(name) => TimeZone::get(name).context("--time-zone").map_err(CommandFailure::Input)?,
        None => TimeZone::system(),
    };
    let map = std::fs::read(&args.map).with_context(|| format!("reading {}", args.map.display()));
    let map = RecordingMap::read(&map.map_err(CommandFailure::Input)?);
    let map =
        map.map_err(|problems| CommandFailure::Input(anyhow!("{}: {}", args.map.display(), problems.join("; "))))?;
    let service =
        ServiceClient::new(&args.server, &args.token_file).map_err(|why| CommandFailure::Input(anyhow!(why)))?;
    if service.is_unencrypted() {
        tracing::warn!("the connection is not encrypted; token and recordings can be read on the way: use https");
    }
    let journal = args.progress.clone().unwrap_or_else(|| beside(&args.map));
    let mut journal = Journal::open(&journal)
        .with_context(|| format!("reading {}", journal.display()))
        .map_err(CommandFailure::Input)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    runtime.block_on(plan_and_send(&args, &map, &service, &mut journal, &zone))
}

/// The usual place of the journal: beside the map.
fn beside(map: &Path) -> PathBuf {
    let mut name = map.as_os_str().to_owned();
    name.push(".progress");
    name.into()
}

async fn plan_and_send(
    args: &UploadArgs,
    map: &RecordingMap,
    service: &ServiceClient,
    journal: &mut Journal,
    zone: &TimeZone,
) -> Result<(), CommandFailure> {
    let directory = Directory::read(service).await.map_err(unreachable_service)?;
    let files = find_files(&args.folder).map_err(CommandFailure::Input)?;
    let defaults = MapDefaults { task: args.task.clone(), in_box: args.in_box.clone() };
    let mapped = assign(files, map, &directory, &defaults, zone);
    let mut plan = UploadPlan { left_out: mapped.left_out, problems: mapped.problems, ..UploadPlan::default() };
    read_recordings(mapped.files, &mut plan, journal, args.quiet);
    mark_copies(&mut plan.recordings, &mut plan.problems);
    look_up(&mut plan, service, args.quiet).await.map_err(unreachable_service)?;
    if !args.send || !plan.problems.is_empty() {
        print_result(&plan.to_text(zone))?;
    }
    match (plan.problems.len(), args.send) {
        (0, true) => send_all(&plan, service, journal, zone).await,
        (0, false) => print_result("Nothing was sent. To send, run the same command with --send.\n"),
        (problems, _) => Err(CommandFailure::Input(anyhow!("{problems} problems, listed above; nothing was sent"))),
    }
}

fn unreachable_service(error: RequestError) -> CommandFailure {
    match error {
        RequestError::Refused { status, .. } if status.as_u16() == 403 => CommandFailure::Input(anyhow!(
            "{error} The token must be of an instructor or administrator, not of a trainee or of a box's agent"
        )),
        other => CommandFailure::Failed(anyhow!("the service: {other}")),
    }
}

/// Reads the recordings: their hashes, and their times where nothing else says them.
fn read_recordings(files: Vec<MappedFile>, plan: &mut UploadPlan, journal: &mut Journal, is_quiet: bool) {
    let mut meter = Meter::new(is_quiet);
    let all = files.len();
    for (index, MappedFile { file, target, recorded_at }) in files.into_iter().enumerate() {
        meter.show("reading", index, all);
        let facts = match file.facts() {
            Ok(facts) => facts,
            Err(why) => {
                plan.problems.push(format!("{}: {why}", file.path));
                continue;
            }
        };
        let recorded_at = match (recorded_at, facts.created_at_ms) {
            (WhenRecorded::Known(found), _) => Some(found),
            (WhenRecorded::Unknown, _) => None,
            (WhenRecorded::AskFile, Some(at_ms)) => Some(RecordedAt::of_file(at_ms)),
            (WhenRecorded::AskFile, None) => {
                plan.problems.push(format!(
                    "{}: neither its name, nor a folder, nor the file says when it was recorded: give `recorded_at` in \
                     the map, or `unknown`",
                    file.path
                ));
                continue;
            }
        };
        match journal.hash_of(&file).map_or_else(|| file.hash(), Ok) {
            Ok(hash) => {
                if journal.hash_of(&file).is_none()
                    && let Err(error) = journal.note(&file, hash, None)
                {
                    tracing::debug!(%error, "the journal cannot be written; the next run reads the file again");
                }
                let fate = Fate::Send;
                plan.recordings.push(PlannedRecording { file, target, recorded_at, hash, fate });
            }
            Err(error) => plan.problems.push(format!("{}: cannot be read: {error}", file.path)),
        }
    }
    meter.finish(&format!("read {}", count_of(all as u64, "recording")));
}

/// Asks the service which of the recordings it has.
async fn look_up(plan: &mut UploadPlan, service: &ServiceClient, is_quiet: bool) -> Result<(), RequestError> {
    let mut meter = Meter::new(is_quiet);
    let all = plan.recordings.len();
    for (index, recording) in plan.recordings.iter_mut().enumerate() {
        meter.show("asking the service", index, all);
        if recording.fate == Fate::Send {
            let sessions = service.read_all(&format!("/sessions?sha256={}", recording.hash)).await?;
            mark_there(recording, &sessions, &mut plan.problems);
        }
    }
    meter.finish("asked the service which of them it has");
    Ok(())
}

impl UploadPlan {
    /// What happens to each file, the files that are left out, and the problems.
    fn to_text(&self, zone: &TimeZone) -> String {
        let mut table = TextTable::new(["recording", "trainee", "task", "box", "recorded", "as said by", ""]);
        for recording in &self.recordings {
            table.add_row(recording.cells(zone));
        }
        let mut text = if table.is_empty() { String::new() } else { table.to_text() };
        if !self.left_out.is_empty() {
            text += &format!("Left out, since they are no recordings: {}\n", self.left_out.join(", "));
        }
        let mut numbers: BTreeMap<&str, usize> = BTreeMap::new();
        for recording in &self.recordings {
            *numbers.entry(recording.fate.name()).or_default() += 1;
        }
        let numbers: Vec<String> = numbers.iter().map(|(name, number)| format!("{number} {name}")).collect();
        text += &format!("{} recordings: {}\n", self.recordings.len(), numbers.join(", "));
        for problem in &self.problems {
            text += &format!("Problem: {problem}\n");
        }
        text
    }
}

impl PlannedRecording {
    fn cells(&self, zone: &TimeZone) -> [String; 7] {
        let (recorded, source) = match self.recorded_at {
            Some(found) if found.is_day => (shown_time(found.at_ms, zone), format!("{} (day only)", found.source)),
            Some(found) => (shown_time(found.at_ms, zone), found.source.to_string()),
            None => ("unknown".to_owned(), "map".to_owned()),
        };
        let fate = match &self.fate {
            Fate::Send => "to send".to_owned(),
            Fate::There { session, but: None } => format!("there already: session {session}"),
            Fate::There { session, but: Some(but) } => format!("there already, but with {but}: session {session}"),
            Fate::Copy(of) => format!("the same as {of}"),
        };
        let target = &self.target;
        let names = [&target.trainee.name, &target.task.name, &target.in_box.name];
        let [trainee, task, in_box] = names.map(String::clone);
        [self.file.path.clone(), trainee, task, in_box, recorded, source, fate]
    }
}

impl Fate {
    fn name(&self) -> &'static str {
        match self {
            Self::Send => "to send",
            Self::There { .. } => "there already",
            Self::Copy(_) => "copies, not sent",
        }
    }
}

/// Sends what is to be sent, one after the other.
async fn send_all(
    plan: &UploadPlan,
    service: &ServiceClient,
    journal: &mut Journal,
    zone: &TimeZone,
) -> Result<(), CommandFailure> {
    let (mut sent, mut there, mut failed) = (0, 0, 0);
    let all = plan.recordings.len();
    for (index, recording) in plan.recordings.iter().enumerate() {
        let shown = recording.cells(zone);
        let [path, trainee, task, in_box, recorded, source, fate] = &shown;
        let place = format!("{}/{all} {path} → {trainee}, {task}, {in_box}, {recorded} ({source})", index + 1);
        if recording.fate != Fate::Send {
            there += 1;
            print_result(&format!("{place}: {fate}\n"))?;
            continue;
        }
        match send(service, recording, journal).await {
            Ok(Arrived { session, is_duplicate }) => {
                let how = if is_duplicate { "there already" } else { "sent" };
                *(if is_duplicate { &mut there } else { &mut sent }) += 1;
                print_result(&format!("{place}: {how}: session {session}\n"))?;
            }
            Err(error) => {
                failed += 1;
                print_result(&format!("{place}: not sent: {error}\n"))?;
                if error.ends_all() {
                    return Err(CommandFailure::Failed(anyhow!(
                        "{error}; {sent} were sent before; run the same command again to continue"
                    )));
                }
            }
        }
    }
    print_result(&format!("{sent} sent, {there} there already or copies, {failed} not sent\n"))?;
    match failed {
        0 => Ok(()),
        _ => Err(CommandFailure::Failed(anyhow!("not sent: {}, see above", count_of(failed as u64, "recording")))),
    }
}
