//! Shows a session live over WebSocket: positions, running features and small pictures (`docs/live.md`).
//!
//! Live values are not stored. The session's trajectory, smoothed once the recording is complete, is what counts. A
//! slow watcher misses messages and receives their number.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::http::HeaderMap;
use axum::response::Response;
use futures_util::SinkExt;
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, interval, interval_at, timeout};
use utoipa::IntoParams;

use super::watched::WatchedSession;
use crate::analysis::protocol::{FollowReply, FollowedFrame, FollowedTool, SeenSoFar, live_features};
use crate::domain::access::AccessedPart;
use crate::domain::files::quality::ConcernDocument;
use crate::domain::scope::Scope;
use crate::domain::session::{LiveFeature, SessionStatus};
use crate::domain::standard::Target;
use crate::http::auth::origin;
use crate::http::auth::signed_in::{Member, SignedIn};
use crate::http::error::{HandlerResult, Refusal, busy};
use crate::http::read::{Params, PathKey};
use crate::http::state::App;
use crate::ids::TaskId;
use crate::live::{EncodedMessage, FeedWatcher, SharedReply, TrackingState};

/// How often to check whether a recording without a sender has resumed or ended.
const POLL_INTERVAL: Duration = Duration::from_secs(1);
/// How often to check that the watcher may still see the session.
const PERMISSION_CHECK_INTERVAL: Duration = Duration::from_secs(4);
/// How old the reading of the session may be for this check; so a lost right is noticed within five seconds.
const MAX_READING_AGE: Duration = Duration::from_secs(1);
/// How long a watcher may take to receive one message, or the messages of one reply.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Size of a watcher's buffer: the messages of one reply without its picture, so that a reply takes one write.
const WRITE_BUFFER_BYTES: usize = 4096;
/// Bytes before a picture: the number of its frame.
const PICTURE_HEADER_BYTES: usize = 8;

/// A message to a watcher.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum LiveMessage {
    /// The limits of the task's standard. The session is judged only once the recording is complete.
    Targets { standard: i64, targets: Vec<Target> },
    /// The recording has no sender at the moment.
    Waiting {
        /// Time of its latest frame, s; `null` if that is not known.
        recorded_s: Option<f64>,
        /// Time until it is ended with the frames that arrived, s.
        ends_in_s: Option<f64>,
    },
    /// The recording is arriving.
    Live {
        width: u32,
        height: u32,
        /// Names of the tools; `null` if the recording is not tracked live, and then `why` gives the reason.
        tools: Option<Vec<String>>,
        why: Option<String>,
    },
    /// A frame was tracked.
    Frame(LiveFrame),
    /// Features so far, the light, and whether camera and trocars have moved.
    Features {
        features: Vec<LiveFeature>,
        light: Option<LiveLight>,
        placement: Option<LivePlacement>,
        /// The movement of the camera during this recording; `null` if there was none so far.
        moved_during: Option<LiveMovement>,
        /// How well each tool was seen so far.
        seen: Vec<LiveSeen>,
        /// The box behind tools without tape is still being learned, so they may be found late.
        is_learning_box: bool,
    },
    /// The watcher was too slow and missed this many messages.
    Missed { count: u64 },
    /// The recording is complete, and the session has this status.
    Ended { status: SessionStatus },
}

#[derive(Debug, Serialize)]
struct LiveFrame {
    frame: u64,
    time_s: f64,
    tools: Vec<LiveTool>,
    /// Distance of the two tips and its standard deviation, mm.
    distance_mm: Option<[f64; 2]>,
}

/// The scene's light, relative to the first frame.
#[derive(Debug, Serialize)]
struct LiveLight {
    luma_ratio: f64,
    chroma_shift: [f64; 2],
}

/// Shifts of camera and trocars since the box's earlier sessions.
#[derive(Debug, Serialize)]
struct LivePlacement {
    /// Shift of the camera; `null` if it has not moved.
    camera: Option<LiveShift>,
    /// Shift of each tool's trocar; `null` if it has not moved, or only together with the camera.
    ports: Vec<Option<LiveShift>>,
}

/// A movement of the camera during the recording.
#[derive(Debug, Serialize)]
struct LiveMovement {
    /// How far, at the depth of the tools.
    mm: f64,
    /// When, s of the recording.
    at_s: f64,
}

#[derive(Debug, Serialize)]
struct LiveShift {
    mm: f64,
    sigma_mm: f64,
}

/// How well a tool was seen so far, by the definitions and limits for finished sessions.
#[derive(Debug, Serialize)]
struct LiveSeen {
    /// Share of the frames on which it was measured, from the first to the last frame with any tool.
    coverage: Option<f64>,
    /// What would make the session one to use with care, or refuse it, if the recording ended now.
    reason: Option<ConcernDocument>,
}

impl LiveSeen {
    fn new(tool: &str, seen: &SeenSoFar) -> Self {
        Self { coverage: seen.coverage, reason: seen.concern(tool).as_ref().map(ConcernDocument::from) }
    }
}

impl LivePlacement {
    /// `None` while no trocar is known.
    fn new(reply: &FollowReply) -> Option<Self> {
        let placement = reply.placement.as_ref()?;
        let shift = |of: (f64, f64)| LiveShift { mm: of.0, sigma_mm: of.1 };
        let camera = placement.camera.map(|of| shift((of.mm, of.sigma_mm)));
        let ports = placement.ports.iter().map(|of| of.map(|of| shift((of.mm, of.sigma_mm)))).collect();
        Some(Self { camera, ports })
    }
}

#[derive(Debug, Serialize)]
struct LiveTool {
    /// `seen`, `bridged` (predicted from its motion for a moment), `left_view` or `lost`.
    state: &'static str,
    /// Why the tool was not measured on this frame.
    reason: Option<&'static str>,
    tip_mm: Option<[f64; 3]>,
    /// Standard deviations across and along the line of sight.
    sigma_mm: Option<[f64; 2]>,
    speed_mm_s: Option<f64>,
    tip_px: Option<[f32; 2]>,
    borders_px: Option<[[f32; 4]; 2]>,
}

impl From<&FollowedTool> for LiveTool {
    fn from(tool: &FollowedTool) -> Self {
        let FollowedTool { seen, path, left_view } = tool;
        let state = match path {
            Some(row) if row.is_observed() => "seen",
            Some(_) => "bridged",
            None if *left_view => "left_view",
            None => "lost",
        };
        Self {
            state,
            reason: tool.reason(),
            tip_mm: path.map(|row| row.tip_mm.into()),
            sigma_mm: path.and_then(|row| row.covariance_mm2).map(|of| [of.sigma_xy_mm(), of.sigma_z_mm()]),
            speed_mm_s: path.and_then(|row| row.velocity_mm_s).map(|v| v.norm()),
            tip_px: seen.tip_px,
            borders_px: seen.borders_px,
        }
    }
}

impl From<&FollowedFrame> for LiveFrame {
    fn from(followed: &FollowedFrame) -> Self {
        let FollowedFrame { frame, time_s, ref tools } = *followed;
        let tools = tools.iter().map(LiveTool::from).collect();
        Self { frame, time_s, tools, distance_mm: followed.distance_mm() }
    }
}

/// Selects what a watcher receives.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LiveQuery {
    /// Whether to send small pictures; `false` for programs that need only numbers.
    #[serde(default = "yes")]
    #[param(default = true)]
    pictures: bool,
}

fn yes() -> bool {
    true
}

/// Watch a session live
///
/// Opens a WebSocket; `docs/live.md` describes the protocol.
#[utoipa::path(get, path = "/sessions/{id}/live", tag = "sessions",
    params(("id" = String, Path, description = "id"), LiveQuery),
    responses((status = 101, description = "The connection is a WebSocket from here on")))]
pub async fn live(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    Params(watched): Params<LiveQuery>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> HandlerResult<Response> {
    let upgrade = upgrade.map_err(|_| {
        Refusal::BadRequest.with(
            "This address accepts only WebSocket connections. To watch in a browser, open the page of the session.",
        )
    })?;
    origin::refuse_foreign(&headers)?;
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let full = || busy("Too many pages are open. Close a page that you no longer need, then try again.");
    let place = app.watcher_slots.take(&by.scope).ok_or_else(full)?;
    app.note_access(&by.scope, session.id, AccessedPart::Video);
    let (shared, task) = (app.watched_sessions.watch(session.id), session.task_id);
    let watcher = Watcher { app, scope: by.scope, headers, session: shared, task, pictures: watched.pictures };
    // A watcher sends no messages, so small buffers are enough.
    let upgrade = upgrade.max_message_size(1024).max_frame_size(1024).read_buffer_size(1024);
    let upgrade = upgrade.write_buffer_size(WRITE_BUFFER_BYTES);
    Ok(upgrade.on_upgrade(move |socket| async move {
        let shutdown = watcher.app.shutdown.clone();
        let connection = shutdown.spawn(async move { watcher.run_and_close(socket).await });
        let _ = connection.await; // a panic is logged where it happened
        drop(place);
    }))
}

/// The connection of one watcher.
struct Watcher {
    app: App,
    scope: Scope,
    headers: HeaderMap,
    session: Arc<WatchedSession>,
    task: TaskId,
    pictures: bool,
}

/// The watcher cannot receive more: disconnected, or not allowed to see the session.
struct WatcherGone;

/// Why [`Watcher::follow`] returned.
enum FollowEnd {
    /// The feed was closed; the recording may resume.
    FeedClosed,
    /// The watcher is gone, see [`WatcherGone`].
    WatcherGone,
}

impl Watcher {
    async fn run_and_close(&self, mut socket: WebSocket) {
        let ending = self.app.shutdown.begun();
        tokio::select! {
            _ = self.run(&mut socket) => {}
            () = SignedIn::wait_until_ended(&self.app, &self.headers) => {}
            () = ending => {}
        }
        let frame = CloseFrame { code: 1000, reason: "".into() };
        // The watcher may be gone already.
        let _ = timeout(SEND_TIMEOUT, socket.send(Message::Close(Some(frame)))).await;
    }

    /// Sends messages until the recording has ended.
    async fn run(&self, socket: &mut WebSocket) -> Result<(), WatcherGone> {
        self.send_targets(socket).await?;
        let (mut is_waiting, mut max_age) = (false, Duration::ZERO);
        loop {
            let status = self.status(max_age).await?;
            if status != SessionStatus::Receiving {
                return send_message(socket, &LiveMessage::Ended { status }).await;
            }
            if let Some(watch) = self.app.feeds.watch(self.session.id, self.pictures).await {
                is_waiting = false;
                match self.follow(socket, watch).await {
                    FollowEnd::FeedClosed => {}
                    FollowEnd::WatcherGone => return Err(WatcherGone),
                }
            } else if !is_waiting {
                is_waiting = true;
                send_message(socket, &self.waiting().await?).await?;
            }
            let paused = Instant::now();
            self.pause(socket).await?;
            max_age = paused.elapsed();
        }
    }

    /// The session's status, at most this old.
    async fn status(&self, max_age: Duration) -> Result<SessionStatus, WatcherGone> {
        self.session.status_for(&self.app.store, &self.scope, max_age).await.ok_or(WatcherGone)
    }

    async fn waiting(&self) -> Result<LiveMessage, WatcherGone> {
        let interruption = self.app.feeds.interruption(self.session.id).await.map_err(|_| WatcherGone)?;
        let recorded_s = interruption.and_then(|known| known.recorded_s);
        Ok(LiveMessage::Waiting { recorded_s, ends_in_s: interruption.map(|known| known.ends_in_s) })
    }

    /// Sends the limits of the task's standard, if it has one. Those for a hand are left out: which tool is in it is known
    /// only after the recording.
    async fn send_targets(&self, socket: &mut WebSocket) -> Result<(), WatcherGone> {
        let standards = self.app.store.standards();
        let Ok(Some(standard)) = standards.in_use(&self.scope, self.task).await else { return Ok(()) };
        let mut targets = standard.definition.targets;
        targets.retain(|target| target.of.in_hand.is_none());
        send_message(socket, &LiveMessage::Targets { standard: standard.version, targets }).await
    }

    /// Waits for about [`POLL_INTERVAL`]; fails if the watcher disconnects.
    async fn pause(&self, socket: &mut WebSocket) -> Result<(), WatcherGone> {
        // All watchers of a recording begin to wait together, and must not ask the database together.
        let pause = tokio::time::sleep(POLL_INTERVAL.mul_f64(rand::random_range(0.75..1.25)));
        tokio::pin!(pause);
        loop {
            tokio::select! {
                () = &mut pause => return Ok(()),
                received = socket.recv() => if !is_connected(received) { return Err(WatcherGone) },
            }
        }
    }

    /// Sends the results of live tracking for as long as the recording is open.
    async fn follow(&self, socket: &mut WebSocket, mut watch: FeedWatcher) -> FollowEnd {
        // The caller has just checked. All watchers of a recording begin together, so their checks are spread.
        let first_check = Instant::now() + PERMISSION_CHECK_INTERVAL.mul_f64(rand::random_range(0.0..1.0));
        let mut still_allowed = interval_at(first_check, PERMISSION_CHECK_INTERVAL);
        let mut still_sent = interval(POLL_INTERVAL);
        watch.state.mark_changed();
        loop {
            let sent = tokio::select! {
                biased;
                received = socket.recv() => if is_connected(received) { Ok(()) } else { Err(WatcherGone) },
                // Checked before the results, because a slow watcher always has results waiting.
                _ = still_allowed.tick() => self.status(MAX_READING_AGE).await.map(drop),
                _ = still_sent.tick(), if watch.replies.is_empty() => {
                    if watch.has_sender() { Ok(()) } else { return FollowEnd::FeedClosed }
                }
                // Closes only together with the results below, so waiting results are still sent.
                Ok(()) = watch.state.changed() => send_message(socket, &live_message(&mut watch)).await,
                news = watch.replies.recv() => match news {
                    Ok(followed) => send_followed(socket, &followed, &watch).await,
                    Err(RecvError::Lagged(count)) => send_message(socket, &LiveMessage::Missed { count }).await,
                    Err(RecvError::Closed) => return FollowEnd::FeedClosed,
                },
            };
            if sent.is_err() {
                return FollowEnd::WatcherGone;
            }
        }
    }
}

fn live_message(watch: &mut FeedWatcher) -> LiveMessage {
    let (tools, why) = match &*watch.state.borrow_and_update() {
        TrackingState::NotStarted => (None, None),
        TrackingState::Tracking(tools) => (Some(tools.clone()), None),
        TrackingState::Unavailable(why) | TrackingState::Refused(why) => (None, Some(why.clone())),
    };
    LiveMessage::Live { width: watch.row.width, height: watch.row.height, tools, why }
}

/// Sends a reply's messages in one piece.
async fn send_followed(socket: &mut WebSocket, followed: &SharedReply, watch: &FeedWatcher) -> Result<(), WatcherGone> {
    let sending = async {
        for message in followed.messages.get_or_init(|| encode_messages(&followed.reply, watch)) {
            let message = match message {
                EncodedMessage::Text(text) => Message::Text(text.clone().try_into().map_err(|_| WatcherGone)?),
                EncodedMessage::Picture(_) if watch.viewer.is_none() => continue,
                EncodedMessage::Picture(picture) => Message::Binary(picture.clone()),
            };
            socket.feed(message).await.map_err(|_| WatcherGone)?;
        }
        socket.flush().await.map_err(|_| WatcherGone)
    };
    timeout(SEND_TIMEOUT, sending).await.unwrap_or(Err(WatcherGone))
}

/// The messages of a reply. They go to all watchers, so nothing in them depends on the watcher.
fn encode_messages(followed: &FollowReply, watch: &FeedWatcher) -> Vec<EncodedMessage> {
    let mut messages: Vec<LiveMessage> =
        followed.frames.iter().map(|frame| LiveMessage::Frame(LiveFrame::from(frame))).collect();
    if let Some(rows) = &followed.running {
        let tools = match &*watch.state.borrow() {
            TrackingState::Tracking(tools) => tools.clone(),
            TrackingState::NotStarted | TrackingState::Unavailable(_) | TrackingState::Refused(_) => Vec::new(),
        };
        let light = followed.light.map(|of| LiveLight { luma_ratio: of.luma_ratio, chroma_shift: of.chroma_shift });
        let placement = LivePlacement::new(followed);
        let seen =
            tools.iter().zip(followed.seen.iter().flatten()).map(|(tool, seen)| LiveSeen::new(tool, seen)).collect();
        let features = live_features(rows, &tools);
        let is_learning_box = followed.is_learning_box;
        let moved_during = followed.moved_during.map(|moved| LiveMovement { mm: moved.mm, at_s: moved.at_s });
        messages.push(LiveMessage::Features { features, light, placement, moved_during, seen, is_learning_box });
    }
    let texts = messages.iter().filter_map(|message| serde_json::to_vec(message).ok());
    let mut encoded: Vec<EncodedMessage> = texts.map(|text| EncodedMessage::Text(text.into())).collect();
    if let Some((frame, jpeg)) = &followed.picture {
        let mut bytes = Vec::with_capacity(PICTURE_HEADER_BYTES + jpeg.len());
        bytes.extend(frame.to_be_bytes());
        bytes.extend(jpeg);
        encoded.push(EncodedMessage::Picture(bytes.into()));
    }
    encoded
}

/// Whether the watcher is still connected. The content of its messages does not matter.
fn is_connected(received: Option<Result<Message, axum::Error>>) -> bool {
    !matches!(received, None | Some(Err(_) | Ok(Message::Close(_))))
}

async fn send_message(socket: &mut WebSocket, message: &LiveMessage) -> Result<(), WatcherGone> {
    let text = serde_json::to_string(message).map_err(|_| WatcherGone)?;
    send(socket, Message::Text(text.into())).await
}

async fn send(socket: &mut WebSocket, message: Message) -> Result<(), WatcherGone> {
    match timeout(SEND_TIMEOUT, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) | Err(_) => Err(WatcherGone),
    }
}
