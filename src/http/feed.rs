//! Receives a box's live feed over WebSocket: control messages as text, records as binary messages (`docs/feed.md`).
//!
//! Each connection has one task. It reads a record, appends it to the log and keeps nothing; syncing to disk runs
//! concurrently. While the log cannot be written, nothing is read, so TCP flow control slows the sender down.

use std::error::Error;
use std::future::ready;
use std::pin::pin;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use futures_util::FutureExt;
use futures_util::future::{Fuse, FusedFuture};
use tokio::time::{Instant, sleep_until, timeout};
use tokio_tungstenite::tungstenite;

use super::auth::origin;
use super::auth::signed_in::SignedIn;
use super::connection_slots::ConnectionSlot;
use super::error::{HandlerResult, Refusal, busy};
use super::read::PathKey;
use super::state::App;
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::feed::early_end::{EarlyEnd, EarlyEndCause};
use crate::domain::feed::messages::{Hello, SenderMessage, ServerMessage};
use crate::domain::feed::record::MAX_RECORD_BYTES;
use crate::domain::scope::{Actor, Scope};
use crate::domain::text::Key;
use crate::domain::token_expiry::expires_soon;
use crate::live::{ConnectResult, Connection};
use crate::time::{millis, to_rfc3339};

/// Longest text message, bytes.
const MAX_TEXT_BYTES: usize = 8192;
/// Most bytes of one read from the socket: a frame at 8 Mbit/s or more. A much smaller buffer would need a system call
/// every few kilobytes. Each box that sends occupies this much memory.
const READ_BYTES: usize = 64 << 10;
/// How long the sender may take to receive a message.
const SEND_TIMEOUT: Duration = Duration::from_secs(5);
/// How often sending frames counts as activity of the signed-in user.
const ACTIVITY_INTERVAL: Duration = Duration::from_secs(60);
/// How long the first message (hello) may take to arrive.
const HELLO_TIMEOUT: Duration = Duration::from_secs(10);

/// Send a box's frames while they are recorded
///
/// Opens a WebSocket; `docs/feed.md` describes the protocol. For the box's agent, and for people who may send
/// recordings.
#[utoipa::path(get, path = "/boxes/{id}/feed", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    responses((status = 101, description = "The connection is a WebSocket from here on")))]
pub async fn feed(
    State(app): State<App>,
    by: SignedIn,
    PathKey(in_box): PathKey,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> HandlerResult<Response> {
    let upgrade = upgrade.map_err(|_| {
        Refusal::BadRequest
            .with("This address accepts only WebSocket connections. `trocar agent` and the page Record send recordings to it.")
    })?;
    origin::refuse_foreign(&headers)?;
    app.store.boxes().get(&by.scope, &in_box).await?;
    let place = app.take_feed_slot(&by.scope)?;
    let by = FeedSender { scope: by.scope, headers };
    let upgrade = upgrade
        .max_message_size(MAX_RECORD_BYTES)
        .max_frame_size(MAX_RECORD_BYTES)
        .read_buffer_size(READ_BYTES)
        .write_buffer_size(0)
        .max_write_buffer_size(1 << 17);
    Ok(upgrade.on_upgrade(move |socket| async move {
        // Spawned through `shutdown`, so that the service waits for it before it exits.
        let connection = app.shutdown.spawn(run_and_close(app.clone(), by, in_box, socket));
        let _ = connection.await; // a panic is logged where it happened
        drop(place);
    }))
}

impl App {
    /// Takes a slot for a connection that sends a recording.
    pub(in crate::http) fn take_feed_slot(&self, scope: &Scope) -> HandlerResult<ConnectionSlot> {
        self.feed_slots.take(scope).ok_or_else(|| {
            if self.feed_slots.is_full_for(scope) {
                let why = "You are sending as many recordings at once as are allowed. End one of them, then try again.";
                Refusal::TooMany.with(why).header(header::RETRY_AFTER, 1)
            } else {
                busy("Too many recordings arrive at once. Try again when one of them has ended.")
            }
        })
    }
}

/// The sender's scope, and the headers that authenticate it.
struct FeedSender {
    scope: Scope,
    headers: HeaderMap,
}

/// Receives the feed, then closes the connection with the reason.
async fn run_and_close(app: App, by: FeedSender, in_box: Key, mut socket: WebSocket) {
    let reason = match run(&app, &by, &in_box, &mut socket).await {
        Ok(()) => CloseReason::new(CloseCode::Done, "the recording is whole"),
        Err(FeedEnd::Disconnected) => {
            return tracing::debug!(in_box = in_box.as_str(), "feed connection lost; the sender may reconnect");
        }
        Err(FeedEnd::Closed(reason)) => reason,
    };
    if reason.code == CloseCode::Done {
        tracing::info!(in_box = in_box.as_str(), "feed ended; recording complete");
    } else {
        tracing::warn!(in_box = in_box.as_str(), code = reason.code.number(), why = reason.why, "feed closed");
    }
    let frame = CloseFrame { code: reason.code.number(), reason: reason.truncated().into() };
    let _ = timeout(SEND_TIMEOUT, socket.send(Message::Close(Some(frame)))).await; // the sender may be gone already
}

/// Why a connection ended before the recording was complete.
enum FeedEnd {
    /// The connection was lost.
    Disconnected,
    /// The service closes the connection and sends this reason.
    Closed(CloseReason),
}

impl From<CloseReason> for FeedEnd {
    fn from(reason: CloseReason) -> Self {
        FeedEnd::Closed(reason)
    }
}

async fn run(app: &App, by: &FeedSender, in_box: &Key, socket: &mut WebSocket) -> Result<(), FeedEnd> {
    let hello = receive_hello(app, socket).await?;
    let mut feed = match app.feeds.connect(&by.scope, in_box, hello).await? {
        ConnectResult::Open(feed) => feed,
        ConnectResult::Ended(session) => return send(socket, &ServerMessage::Ended { session, durable: None }).await,
    };
    let mut welcome = feed.welcome().await?;
    if let ServerMessage::Welcome { token_expires_at, session, .. } = &mut welcome {
        if let Actor::Agent(of) = by.scope.actor()
            && app.box_agents.note_session(of, *session)
        {
            let _ = app.announce_check_in(of).await; // a store error delays only what the box's screen shows
        }
        let expires_at_ms = SignedIn::token_expiry(app, &by.headers).await;
        *token_expires_at = expires_soon(expires_at_ms, app.clock.now_ms()).map(to_rfc3339);
    }
    send(socket, &welcome).await?;
    if matches!(welcome, ServerMessage::Ended { .. }) {
        return Ok(());
    }
    let received = receive_recording(app, &by.headers, &mut feed, socket).await;
    if matches!(received, Err(FeedEnd::Disconnected)) {
        feed.record_closed();
    }
    received
}

async fn receive_hello(app: &App, socket: &mut WebSocket) -> Result<Hello, FeedEnd> {
    let first = tokio::select! {
        first = timeout(HELLO_TIMEOUT, receive(socket)) => match first {
            Ok(first) => first?,
            Err(_) => return Err(CloseReason::new(CloseCode::Silent, "no hello arrived in time").into()),
        },
        () = app.shutdown.begun() => return Err(CloseReason::service_stopping().into()),
    };
    match first {
        ReceivedMessage::Control(SenderMessage::Hello(hello)) => Ok(hello),
        _ => {
            let why = "the first message of a connection must be hello";
            Err(CloseReason::new(CloseCode::NotUnderstood, why).into())
        }
    }
}

/// Appends records and acknowledges what is durable, until the recording is complete.
async fn receive_recording(
    app: &App,
    headers: &HeaderMap,
    feed: &mut Connection,
    socket: &mut WebSocket,
) -> Result<(), FeedEnd> {
    let settings = app.feeds.settings();
    let mut ack_at = None;
    let mut syncing = pin!(Fuse::terminated());
    let mut signed_out = pin!(SignedIn::wait_until_ended(app, headers));
    let mut silent_at = Instant::now() + settings.silent();
    let mut activity = UserActivity { app, headers, recorded_ms: app.clock.now_ms() };
    loop {
        let has_room = feed.has_capacity();
        let message = tokio::select! {
            biased;
            reason = feed.wait_until_closed() => return Err(reason.into()),
            () = &mut signed_out => return Err(CloseReason::signed_out().into()),
            durable = &mut syncing, if !syncing.is_terminated() => {
                send(socket, &ServerMessage::Ack { durable: durable? }).await?;
                continue;
            }
            () = sleep_until(ack_at.unwrap_or(silent_at)), if ack_at.is_some() && syncing.is_terminated() => {
                ack_at = None;
                syncing.set(feed.begin_sync().await?.fuse());
                continue;
            }
            () = feed.wait_for_capacity(), if !has_room => {
                silent_at = Instant::now() + settings.silent(); // the service did not read; the sender was not silent
                continue;
            }
            message = receive(socket), if has_room => message?,
            () = ready(()), if feed.has_unwritten() => {
                feed.write().await?; // no further record has arrived yet
                continue;
            }
            () = sleep_until(silent_at), if has_room => {
                return Err(CloseReason::new(CloseCode::Silent, "nothing was heard for too long").into());
            }
        };
        silent_at = Instant::now() + settings.silent();
        feed.record_contact();
        match message {
            ReceivedMessage::Record(record) => {
                feed.take_record(record).await?;
                activity.record().await;
                if ack_at.is_none() && feed.is_unsynced() {
                    ack_at = Some(Instant::now() + settings.ack());
                }
            }
            ReceivedMessage::Control(SenderMessage::End { frames, source_lost, broken_off }) => {
                let lost = source_lost.map(|why| EarlyEnd::of(EarlyEndCause::SourceLost).with(&why));
                let early = lost.or(broken_off.map(|why| EarlyEnd::of(EarlyEndCause::SenderGone).with(&why)));
                let answer = feed.end(frames, early).await?;
                send(socket, &answer).await?;
                if matches!(answer, ServerMessage::Ended { .. }) {
                    return Ok(());
                }
            }
            ReceivedMessage::Control(SenderMessage::Hello(_)) => {
                return Err(CloseReason::new(CloseCode::NotUnderstood, "hello may be sent only once").into());
            }
            ReceivedMessage::Heartbeat => {}
        }
    }
}

/// Lets frames count as activity of the signed-in user. A page that records sends no other requests, and must not be
/// signed out as idle meanwhile.
struct UserActivity<'a> {
    app: &'a App,
    headers: &'a HeaderMap,
    recorded_ms: i64,
}

impl UserActivity<'_> {
    /// Records activity, at most once in [`ACTIVITY_INTERVAL`].
    async fn record(&mut self) {
        let now_ms = self.app.clock.now_ms();
        if now_ms - self.recorded_ms >= millis(ACTIVITY_INTERVAL) {
            self.recorded_ms = now_ms;
            SignedIn::record_activity(self.app, self.headers).await;
        }
    }
}

/// A message from the sender.
enum ReceivedMessage {
    Control(SenderMessage),
    Record(axum::body::Bytes),
    /// A ping or pong: the sender is still connected.
    Heartbeat,
}

async fn receive(socket: &mut WebSocket) -> Result<ReceivedMessage, FeedEnd> {
    match socket.recv().await {
        None | Some(Ok(Message::Close(_))) => Err(FeedEnd::Disconnected),
        Some(Err(error)) => Err(classify_socket_error(&error)),
        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(ReceivedMessage::Heartbeat),
        Some(Ok(Message::Binary(bytes))) => Ok(ReceivedMessage::Record(bytes)),
        Some(Ok(Message::Text(text))) if text.len() > MAX_TEXT_BYTES => {
            let why = format!("a text message has {} bytes; at most {MAX_TEXT_BYTES} are accepted", text.len());
            Err(CloseReason::new(CloseCode::TooLarge, why).into())
        }
        Some(Ok(Message::Text(text))) => match serde_json::from_str(&text) {
            Ok(message) => Ok(ReceivedMessage::Control(message)),
            Err(error) => {
                Err(CloseReason::new(CloseCode::NotUnderstood, format!("a text message is not understood: {error}"))
                    .into())
            }
        },
    }
}

/// A message that is too long is the sender's mistake; any other error is a lost connection.
fn classify_socket_error(error: &axum::Error) -> FeedEnd {
    let cause = error.source().and_then(|cause| cause.downcast_ref::<tungstenite::Error>());
    if matches!(cause, Some(tungstenite::Error::Capacity(_))) {
        return CloseReason::new(CloseCode::TooLarge, format!("a message is longer than {MAX_RECORD_BYTES} bytes"))
            .into();
    }
    FeedEnd::Disconnected
}

async fn send(socket: &mut WebSocket, message: &ServerMessage) -> Result<(), FeedEnd> {
    let text = serde_json::to_string(message).unwrap_or_default(); // plain data always serialises
    match timeout(SEND_TIMEOUT, socket.send(Message::Text(text.into()))).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) => Err(FeedEnd::Disconnected),
        Err(_) => Err(CloseReason::new(CloseCode::Silent, "the sender does not read").into()),
    }
}

#[cfg(test)]
mod tests {
    use tokio_tungstenite::tungstenite::error::{CapacityError, ProtocolError};

    use super::*;

    #[test]
    fn only_a_message_that_is_too_long_closes_the_feed_with_a_reason() {
        let end = |error: tungstenite::Error| classify_socket_error(&axum::Error::new(error));
        let too_long = CapacityError::MessageTooLong { size: MAX_RECORD_BYTES + 1, max_size: MAX_RECORD_BYTES };
        let FeedEnd::Closed(reason) = end(too_long.into()) else { panic!("not closed") };
        assert_eq!(reason.code, CloseCode::TooLarge);
        let reset = ProtocolError::ResetWithoutClosingHandshake;
        assert!(matches!(end(reset.into()), FeedEnd::Disconnected));
        // The text of an error does not decide.
        let text = std::io::Error::other("Space limit exceeded: message too long");
        assert!(matches!(end(text.into()), FeedEnd::Disconnected));
    }
}
