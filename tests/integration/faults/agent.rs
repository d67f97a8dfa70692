//! The real `trocar agent` with a clip as its camera: the session has the clip's frames, even if agent or service are
//! killed on the way.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use trocar::domain::feed::numbers::FrameNumbers;
use trocar::domain::feed::record::read_all;
use trocar::media::{MediaLimits, VideoFile};

use super::Centre;
use super::centre::json_of;
use crate::box_agent::BoxComputer;
use crate::process::program;
use crate::support::{let_time_pass, poll, poll_until};

/// Number, time in s and hash of the samples of each frame.
pub(super) type DecodedFrames = Vec<(u64, f64, u64)>;

pub(super) fn decode(path: &Path) -> DecodedFrames {
    let mut video = VideoFile::open(std::fs::File::open(path).unwrap(), MediaLimits::default()).unwrap();
    let picture = std::iter::from_fn(|| video.next_picture().unwrap());
    let frames = picture.map(|picture| {
        let frame = picture.frame();
        let mut hasher = DefaultHasher::new();
        for plane in [frame.y, frame.u, frame.v] {
            (0..plane.height).for_each(|row| plane.row(row).hash(&mut hasher));
        }
        (frame.index, frame.time_s, hasher.finish())
    });
    frames.collect()
}

/// A service, and what its agent needs: a relay with a fixed address, a token and a spool.
pub(super) struct AgentSetup {
    pub(super) centre: Centre,
    pub(super) folder: tempfile::TempDir,
    pub(super) relay: Relay,
}

impl AgentSetup {
    pub(super) async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let centre = Centre::open_bare(folder, data, |_| ()).await;
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("token"), centre.token()).unwrap();
        let relay = Relay::to(centre.host()).await;
        Self { centre, folder, relay }
    }

    fn spool(&self) -> PathBuf {
        self.folder.path().join("spool")
    }

    /// `trocar agent`, with these arguments behind those that it always needs.
    fn agent(&self, arguments: &[&str]) -> Agent {
        let mut agent = program();
        agent.args(["agent", "--box", "box-1", "--server", &format!("http://{}", self.relay.host)]);
        agent.arg("--token-file").arg(self.folder.path().join("token")).arg("--spool").arg(self.spool());
        Agent(agent.args(arguments).stderr(Stdio::inherit()).spawn().unwrap())
    }

    /// An agent that records a clip.
    fn record(&self, clip: &Path, arguments: &[&str]) -> Agent {
        let clip = clip.to_str().unwrap();
        self.agent(&[arguments, &["--trainee", "ada", "--task", "pegs", clip][..]].concat())
    }

    /// Kills the service; the relay then drops all connections.
    fn kill_the_service(&mut self) {
        self.relay.target.send_replace(None);
        self.centre.kill();
    }

    async fn restart_the_service(&mut self) {
        self.centre.restart().await;
        self.relay.target.send_replace(Some(self.centre.host()));
    }

    /// Bytes that the service has of unfinished recordings.
    fn arrived(&self) -> u64 {
        let logs = std::fs::read_dir(self.centre.data().join("feeds")).unwrap();
        logs.map(|log| log.unwrap().metadata().unwrap().len()).sum()
    }

    /// The frame numbers that the service has a record for.
    fn on_the_server(&self) -> FrameNumbers {
        let mut numbers = FrameNumbers::default();
        for log in std::fs::read_dir(self.centre.data().join("feeds")).unwrap() {
            let read = read_all(std::fs::File::open(log.unwrap().path()).unwrap(), |_, record| {
                numbers.add(record.number, record.last_number()).unwrap();
                std::io::Result::Ok(())
            });
            read.unwrap();
        }
        numbers
    }

    /// Bytes in the spool; an agent may be running.
    fn spooled(&self) -> u64 {
        files_in(&self.spool()).iter().map(|file| std::fs::metadata(file).map_or(0, |found| found.len())).sum()
    }

    /// The newest session, once its recording has arrived.
    async fn newest_session(&self) -> Value {
        let sessions = self.centre.until("/sessions", |list| list["items"][0]["status"] != "receiving").await;
        let answer = self.centre.get(&format!("/sessions/{}", sessions["items"][0]["id"].as_str().unwrap())).await;
        answer.json().await.unwrap()
    }

    /// The frames of the newest session's recording.
    async fn session_frames(&self) -> DecodedFrames {
        let sessions = self.centre.until("/sessions", |list| list["items"][0]["status"] != "receiving").await;
        let id = sessions["items"][0]["id"].as_str().unwrap();
        let video = self.centre.get(&format!("/sessions/{id}/video")).await;
        assert!(video.status().is_success());
        let path = self.folder.path().join("session.mp4");
        std::fs::write(&path, video.bytes().await.unwrap()).unwrap();
        decode(&path)
    }
}

fn files_in(spool: &Path) -> Vec<PathBuf> {
    let folders = std::fs::read_dir(spool).into_iter().flatten().flatten().map(|entry| entry.path());
    let files = folders.filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
    files.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|suffix| suffix == "records")).collect()
}

/// A running agent. Dropping it kills it.
struct Agent(Child);

impl Agent {
    async fn wait_for_exit(mut self) -> ExitStatus {
        poll("the end of the agent", async || self.0.try_wait().unwrap()).await
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        let _ = self.0.kill(); // SIGKILL; it may have ended already
        let _ = self.0.wait();
    }
}

/// A fixed address that forwards to the service's present address, or drops connections.
pub(super) struct Relay {
    pub(super) host: String,
    target: watch::Sender<Option<String>>,
    /// True while the network is away: no byte passes, and no connection ends.
    is_silent: watch::Sender<bool>,
}

impl Relay {
    async fn to(service: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let host = listener.local_addr().unwrap().to_string();
        let (target, to) = watch::channel(Some(service));
        let (is_silent, silence) = watch::channel(false);
        tokio::spawn(async move {
            while let Ok((mut from, _)) = listener.accept().await {
                let (mut to, mut silence, mut after) = (to.clone(), silence.clone(), silence.clone());
                tokio::spawn(async move {
                    let _ = after.wait_for(|is_silent| !is_silent).await; // the sender lives as long as the test
                    let Some(service) = to.borrow_and_update().clone() else { return };
                    let Ok(mut service) = TcpStream::connect(service).await else { return };
                    tokio::select! {
                        _ = tokio::io::copy_bidirectional(&mut from, &mut service) => {}
                        _ = to.changed() => {}
                        _ = silence.wait_for(|is_silent| *is_silent) => {}
                    }
                    let _ = after.wait_for(|is_silent| !is_silent).await; // then both ends learn that it is cut
                });
            }
        });
        Self { host, target, is_silent }
    }

    /// Takes the network away, or brings it back.
    pub(super) fn set_silent(&self, is_silent: bool) {
        self.is_silent.send_replace(is_silent);
    }
}

/// Live streams over HTTP, one for each connection. After the last one the address refuses connections.
async fn serve_streams(streams: Vec<Vec<u8>>, then: AfterStream) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}/live.ts", listener.local_addr().unwrap());
    tokio::spawn(async move {
        let mut silent = Vec::new();
        for stream in streams {
            let (mut socket, _) = listener.accept().await.unwrap();
            let request = socket.read(&mut [0; 4096]).await.unwrap();
            assert!(request > 0);
            socket.write_all(b"HTTP/1.0 200 OK\r\nContent-Type: video/mp2t\r\n\r\n").await.unwrap();
            // The agent may have closed the connection: it has what it needs.
            let _ = socket.write_all(&stream).await;
            match then {
                AfterStream::Closes => drop(socket),
                AfterStream::IsSilent => silent.push(socket),
            }
        }
        drop(listener);
        std::future::pending::<()>().await; // holds the silent connections
    });
    address
}

/// What a stream does after its last byte.
#[derive(Clone, Copy)]
enum AfterStream {
    Closes,
    IsSilent,
}

/// The clip as a transport stream, which can be cut anywhere.
fn transport_stream(clip: &Path, folder: &Path) -> Vec<u8> {
    let path = folder.join("clip.ts");
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-i"]).arg(clip).args(["-c", "copy", "-f", "mpegts"]);
    assert!(ffmpeg.arg(&path).status().unwrap().success());
    std::fs::read(&path).unwrap()
}

/// The clip as MJPEG: each frame can be decoded without the others.
fn jpegs(clip: &Path, folder: &Path) -> PathBuf {
    let path = folder.join("clip.avi");
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-i"]).arg(clip).args(["-c:v", "mjpeg", "-q:v", "3"]);
    assert!(ffmpeg.arg(&path).status().unwrap().success());
    path
}

/// The clip, repeated for `seconds`.
fn repeated(clip: &Path, seconds: u64) -> PathBuf {
    let path = clip.with_file_name("repeated.avi");
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-stream_loop", "-1", "-i"]).arg(clip).args(["-c", "copy", "-t", &seconds.to_string()]);
    assert!(ffmpeg.arg(&path).status().unwrap().success());
    path
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_clip_as_camera_becomes_the_session_that_its_upload_would_be() {
    let setup = AgentSetup::new().await;
    let clip = setup.centre.scene("clip.mp4");
    assert!(setup.record(&clip, &["--as-fast-as-possible"]).wait_for_exit().await.success());
    assert_eq!(setup.session_frames().await, decode(&clip), "the same frames at the same times, to the last bit");
    assert_eq!(files_in(&setup.spool()), Vec::<PathBuf>::new(), "the spool keeps nothing of a complete recording");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_that_closes_is_opened_again_and_the_recording_continues_after_a_gap() {
    let setup = AgentSetup::new().await;
    let clip = setup.centre.scene("clip.mp4");
    let stream = transport_stream(&clip, setup.folder.path());
    let whole = decode(&clip);
    let length_s = whole[whole.len() - 1].1;
    let address = serve_streams(vec![stream[..stream.len() / 2].to_vec(), stream], AfterStream::Closes).await;
    let seconds = length_s.to_string(); // reached in the second stream
    let arguments = ["--trainee", "ada", "--task", "pegs", "--seconds", &seconds, &address];
    assert!(setup.agent(&arguments).wait_for_exit().await.success());
    let times: Vec<f64> = setup.session_frames().await.iter().map(|frame| frame.1).collect();
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let gap = steps.iter().position(|step| *step >= 0.4).unwrap_or_else(|| panic!("no gap in {times:?}"));
    assert!(gap > 5 && gap + 5 < times.len(), "frames before and after the gap: {times:?}");
    assert!(steps.iter().all(|step| *step > 0.0), "{times:?}");
    assert!(setup.newest_session().await["early_end"].is_null());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_that_does_not_come_back_fails_the_agent_and_the_session_says_why() {
    let setup = AgentSetup::new().await;
    let stream = transport_stream(&setup.centre.scene("clip.mp4"), setup.folder.path());
    for (then, cut, why) in
        [(AfterStream::Closes, 2, "the source ended"), (AfterStream::IsSilent, 3, "the source sent nothing for 500ms")]
    {
        let address = serve_streams(vec![stream[..stream.len() - stream.len() / cut].to_vec()], then).await;
        let patience = ["--silence-s", "0.5", "--reconnect-s", "0.7", "--option", "analyzeduration=200000"];
        let recording = ["--trainee", "ada", "--task", "pegs", &address];
        let agent = setup.agent(&[&patience[..], &recording].concat());
        assert_eq!(agent.wait_for_exit().await.code(), Some(1), "{why}");
        let session = setup.newest_session().await;
        assert_eq!(session["early_end"]["cause"], "source_lost", "{session}");
        let detail = session["early_end"]["detail"].as_str().unwrap();
        // A connection that closes within a packet is an error of the reader, not the end of the stream.
        let reasons = [why, "the source can no longer be read (Input/output error)"];
        let known = reasons.map(|why| format!("{why} and was not back after 700ms"));
        assert!(known.iter().any(|known| known == detail), "{detail}");
        assert!(setup.session_frames().await.len() > 5);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recording_ends_at_its_planned_time_while_its_stream_is_away() {
    let setup = AgentSetup::new().await;
    let stream = transport_stream(&setup.centre.scene("clip.mp4"), setup.folder.path());
    let address = serve_streams(vec![stream[..stream.len() / 2].to_vec()], AfterStream::Closes).await;
    let planned = ["--reconnect-s", "600", "--seconds", "1", "--option", "analyzeduration=200000"];
    let agent = setup.agent(&[&planned[..], &["--trainee", "ada", "--task", "pegs", &address]].concat());
    assert!(agent.wait_for_exit().await.success());
    let session = setup.newest_session().await;
    assert!(session["early_end"].is_null(), "{session}");
    assert!(setup.session_frames().await.len() > 5);
}

/// An agent that continues to record after its service was killed.
async fn record_without_a_service(setup: &mut AgentSetup, clip: &Path) -> Agent {
    let agent = setup.record(clip, &[]);
    poll_until("the arrival of frames", || setup.arrived() > 0).await;
    setup.kill_the_service();
    let before = setup.spooled();
    poll_until("the growth of the spool", || setup.spooled() > before).await;
    agent
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_dies_and_stays_away_costs_no_frame() {
    let mut setup = AgentSetup::new().await;
    let clip = setup.centre.scene("clip.mp4");
    let agent = record_without_a_service(&mut setup, &clip).await;
    setup.restart_the_service().await;
    assert!(agent.wait_for_exit().await.success());
    assert_eq!(setup.session_frames().await, decode(&clip));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_box_that_stands_by_records_on_while_the_service_is_away() {
    const STEP_S: f64 = 0.04;
    let mut setup = AgentSetup::new().await;
    let token = json!({"name": "box 1", "role": "agent", "box": "box-1"});
    let token = json_of(setup.centre.create_signed_in("/tokens", &token).await).await;
    let computer = BoxComputer::new(token["token"].as_str().unwrap(), 60);
    let agent = computer.stand_by(&format!("http://{}", setup.relay.host), &[]);
    let at = "/boxes/box-1/agent";
    setup.centre.until(at, |state| state["camera"]["is_open"] == true).await;
    let target = json!({"trainee": "ada", "task": "pegs"});
    json_of(setup.centre.create_signed_in(&format!("{at}/start"), &target).await).await;
    poll_until("the arrival of frames", || setup.arrived() > 0).await;
    setup.kill_the_service();
    let frames = async || {
        let state: Value = reqwest::get(agent.screen("/state")).await.unwrap().json().await.unwrap();
        state["state"]["recording"]["frames"].as_u64().unwrap()
    };
    let before = frames().await;
    poll("frames without a service", async || (frames().await > before + 25).then_some(())).await;
    setup.restart_the_service().await;
    setup.centre.until(at, |state| !state["recording"].is_null() && state["presence"] == "live").await;
    let recorded = frames().await;
    json_of(setup.centre.create_signed_in(&format!("{at}/stop"), &json!({})).await).await;
    let times: Vec<f64> = setup.session_frames().await.iter().map(|frame| frame.1).collect();
    assert!(times.len() as u64 >= recorded, "{} of {recorded} frames", times.len());
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(steps.clone().all(|step| (step - STEP_S).abs() < 0.001), "no frame is missing: {times:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes ten minutes and more: make long-absence"]
async fn a_service_that_was_away_for_long_soon_has_everything_and_live_frames_first() {
    const RECORDS_ON_S: u64 = 120;
    let away: u64 = std::env::var_os("TROCAR_AWAY_S").map_or(600, |seconds| seconds.to_str().unwrap().parse().unwrap());
    let mut setup = AgentSetup::new().await;
    let clip = repeated(&jpegs(&setup.centre.scene("clip.mp4"), setup.folder.path()), away + RECORDS_ON_S);
    let agent = setup.record(&clip, &[]);
    poll_until("the arrival of frames", || setup.arrived() > 0).await;
    setup.kill_the_service();
    let_time_pass(Duration::from_secs(away)).await;
    let recorded = captured(&setup.spool());
    let waiting = setup.spooled();
    setup.restart_the_service().await;

    let (back, mut live_at, mut lags) = (Instant::now(), None, Vec::new());
    loop {
        let_time_pass(Duration::from_secs(1)).await; // the whole log is read each time
        let (captured, arrived) = (captured(&setup.spool()), setup.on_the_server());
        let newest = arrived.ranges().last().map_or(0, |range| range[1]);
        if newest >= recorded {
            live_at.get_or_insert_with(|| back.elapsed());
            lags.push(captured.saturating_sub(newest + 1));
        }
        if (0..recorded).all(|number| arrived.contains(number)) {
            break;
        }
        assert!(back.elapsed() < Duration::from_secs(RECORDS_ON_S), "{:?} is there of {recorded}", arrived.ranges());
    }
    lags.sort_unstable();
    println!(
        "away {away} s: {recorded} frames, {:.0} MB; live frames {:.1} s after it was back, all others after {:.1} s; \
         until then the newest frame on the server was {} frames behind (median), {} at most",
        waiting as f64 / 1e6,
        live_at.unwrap().as_secs_f64(),
        back.elapsed().as_secs_f64(),
        lags[lags.len() / 2],
        lags[lags.len() - 1],
    );
    let_time_pass(Duration::from_secs(RECORDS_ON_S).saturating_sub(back.elapsed())).await;
    assert!(agent.wait_for_exit().await.success());
    // The clip and the feed have different time bases: times agree to the microsecond.
    let to_us = |frames: DecodedFrames| {
        frames.into_iter().map(|(n, time_s, of)| (n, (time_s * 1e6).round() as u64, of)).collect()
    };
    let (session, clip): (Vec<_>, Vec<_>) = (to_us(setup.session_frames().await), to_us(decode(&clip)));
    let difference = session.iter().zip(&clip).position(|(one, other)| one != other);
    assert_eq!((difference, session.len()), (None, clip.len()), "every frame, at its time, to the last bit");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_agent_that_is_killed_loses_nothing_that_was_in_its_spool() {
    let mut setup = AgentSetup::new().await;
    let clip = setup.centre.scene("clip.mp4");
    let agent = record_without_a_service(&mut setup, &clip).await;
    drop(agent); // SIGKILL
    let captured = captured(&setup.spool());
    assert!(captured > 5, "{captured}");

    setup.restart_the_service().await;
    assert!(setup.agent(&[]).wait_for_exit().await.success());
    let (session, clip) = (setup.session_frames().await, decode(&clip));
    // The last frames may depend on frames that are decoded before them and were not captured.
    assert!(session.len() as u64 > captured - 4 && session.len() as u64 <= captured, "{} of {captured}", session.len());
    let shown = session.iter().filter(|frame| clip.contains(frame)).count();
    assert!(shown as u64 > captured - 4, "{shown} of {captured}");
    assert_eq!(files_in(&setup.spool()), Vec::<PathBuf>::new());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_that_the_disk_lost_is_a_gap_and_costs_no_other_frame() {
    let mut setup = AgentSetup::new().await;
    let clip = jpegs(&setup.centre.scene("clip.mp4"), setup.folder.path());
    setup.kill_the_service();
    let agent = setup.record(&clip, &["--as-fast-as-possible"]);
    let frames = decode(&clip).len() as u64;
    poll_until("the capture", || setup.spooled() >= std::fs::metadata(&clip).unwrap().len() * 9 / 10).await;
    drop(agent);
    let captured = captured(&setup.spool());
    assert!(captured > frames / 2);
    let segment = files_in(&setup.spool()).remove(0);
    let mut bytes = std::fs::read(&segment).unwrap();
    bytes[40] ^= 1; // in the first frame
    let cut = bytes.len() - 7; // and a torn write at the end
    std::fs::write(&segment, &bytes[..cut]).unwrap();

    setup.restart_the_service().await;
    assert!(setup.agent(&[]).wait_for_exit().await.success());
    let session: Vec<u64> = setup.session_frames().await.iter().map(|frame| (frame.1 * 1e6).round() as u64).collect();
    let expected = &decode(&clip)[1..captured as usize - 1];
    let expected: Vec<u64> = expected.iter().map(|frame| ((frame.1 - expected[0].1) * 1e6).round() as u64).collect();
    let began = session[0];
    assert_eq!(session.iter().map(|time| time - began).collect::<Vec<_>>(), expected);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_refused_recording_fails_the_agent_and_stays_in_the_spool() {
    let setup = AgentSetup::new().await;
    let clip = setup.centre.scene("clip.mp4");
    let arguments = ["--trainee", "missing", "--task", "pegs", clip.to_str().unwrap()];
    assert_eq!(setup.agent(&arguments).wait_for_exit().await.code(), Some(1));
    assert_eq!(files_in(&setup.spool()).len(), 1);
    std::fs::write(setup.folder.path().join("token"), "trc_wrong").unwrap();
    assert_eq!(setup.agent(&[]).wait_for_exit().await.code(), Some(1));
    assert_eq!(files_in(&setup.spool()).len(), 1);
}

/// One more than the largest frame number in a spool's files.
fn captured(spool: &Path) -> u64 {
    let end_of = |path: &PathBuf| {
        let mut end = 0;
        let file = std::fs::File::open(path).ok()?; // the agent may delete a delivered file meanwhile
        let read = read_all(file, |_, record| {
            end = end.max(record.last_number() + 1);
            std::io::Result::Ok(())
        });
        read.unwrap();
        (end > 0).then_some(end)
    };
    let mut files = files_in(spool);
    files.sort(); // by number: the last file with a record has the largest
    files.iter().rev().find_map(end_of).unwrap_or(0)
}
