//! Receives a box's live feed over WebSocket: control messages as text, records as binary messages (`docs/feed.md`).
//!
//! Each connection has one task. It reads a record, appends it to the log and keeps nothing; syncing to disk runs
//! concurrently. While the log cannot be written, nothing is read, so TCP flow control slows the sender down.

use std::future::ready;
use std::pin::pin;
use std::time::Duration;

use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use futures_util::FutureExt;
use futures_util::future::{Fuse, FusedFuture};
use tokio::time::{Instant, sleep_until, timeout};

use super::auth::origin;
use super::auth::signed_in::SignedIn;
use super::error::{Answer, Refusal, busy};
use super::state::App;
use crate::domain::feed::farewell::{Code, Farewell};
use crate::domain::feed::record::MOST_BYTES;
use crate::domain::feed::words::{FromSender, FromServer};
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::live::Connected;
use crate::time::millis;

/// Longest text message, bytes.
const MOST_WORD: usize = 8192;
/// Most bytes of one read from the socket: a frame at 8 Mbit/s or more. A much smaller buffer would need a system call
/// every few kilobytes. Each box that sends occupies this much memory.
const READ_BYTES: usize = 64 << 10;
/// How long the sender may take to receive a message.
const LAST_WORDS: Duration = Duration::from_secs(5);
/// How often sending frames counts as activity of the signed-in user.
const PRESENT_EVERY: Duration = Duration::from_secs(60);
/// How long the first message (hello) may take to arrive.
const HELLO: Duration = Duration::from_secs(10);

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
    Path(in_box): Path<String>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Answer<Response> {
    let upgrade = upgrade.map_err(|_| {
        Refusal::BadRequest
            .with("This address accepts only WebSocket connections. docs/feed.md describes the protocol.")
    })?;
    origin::refuse_foreign(&headers)?;
    let in_box = Key::from(&in_box);
    app.store.boxes().get(&by.scope, &in_box).await?;
    let full = |_| busy("Too many boxes are recording at once. Try again when one of them has ended.");
    let place = app.feed_places.clone().try_acquire_owned().map_err(full)?;
    let by = By { scope: by.scope, headers };
    let upgrade = upgrade
        .max_message_size(MOST_BYTES)
        .max_frame_size(MOST_BYTES)
        .read_buffer_size(READ_BYTES)
        .write_buffer_size(0)
        .max_write_buffer_size(1 << 17);
    Ok(upgrade.on_upgrade(move |socket| async move {
        // Spawned through `shutdown`, so that the service waits for it before it exits.
        let talk = app.shutdown.spawn(talk(app.clone(), by, in_box, socket));
        let _ = talk.await; // a panic is logged where it happened
        drop(place);
    }))
}

/// The sender's scope, and the headers that authenticate it.
struct By {
    scope: Scope,
    headers: HeaderMap,
}

/// Receives the feed, then closes the connection with the reason.
async fn talk(app: App, by: By, in_box: Key, mut socket: WebSocket) {
    let farewell = match converse(&app, &by, &in_box, &mut socket).await {
        Ok(()) => Farewell::new(Code::Done, "the recording is whole"),
        Err(End::Gone) => {
            return tracing::debug!(in_box = in_box.as_str(), "feed connection lost; the sender may reconnect");
        }
        Err(End::Told(farewell)) => farewell,
    };
    if farewell.code == Code::Done {
        tracing::info!(in_box = in_box.as_str(), "feed ended; recording complete");
    } else {
        tracing::warn!(in_box = in_box.as_str(), code = farewell.code.number(), why = farewell.why, "feed closed");
    }
    let frame = CloseFrame { code: farewell.code.number(), reason: farewell.short().into() };
    let _ = timeout(LAST_WORDS, socket.send(Message::Close(Some(frame)))).await; // the sender may be gone already
}

/// Why a connection ended before the recording was complete.
enum End {
    /// The connection was lost.
    Gone,
    /// The service closes the connection and sends this reason.
    Told(Farewell),
}

impl From<Farewell> for End {
    fn from(farewell: Farewell) -> Self {
        End::Told(farewell)
    }
}

async fn converse(app: &App, by: &By, in_box: &Key, socket: &mut WebSocket) -> Result<(), End> {
    let By { scope, headers } = by;
    let hello = tokio::select! {
        first = timeout(HELLO, next(socket)) => match first {
            Ok(first) => first?,
            Err(_) => return Err(Farewell::new(Code::Silent, "no hello arrived in time").into()),
        },
        () = app.shutdown.begun() => return Err(Farewell::service_ends().into()),
    };
    let Heard::Word(FromSender::Hello(hello)) = hello else {
        return Err(Farewell::new(Code::NotUnderstood, "the first message of a connection must be hello").into());
    };
    let mut feed = match app.feeds.connect(scope, in_box, hello).await? {
        Connected::Open(feed) => feed,
        Connected::Ended(session) => return say(socket, &FromServer::Ended { session, durable: None }).await,
    };
    let welcome = feed.welcome().await?;
    say(socket, &welcome).await?;
    if matches!(welcome, FromServer::Ended { .. }) {
        return Ok(());
    }
    let settings = app.feeds.settings();
    let mut ack_at = None;
    let mut syncing = pin!(Fuse::terminated());
    let mut signed_out = pin!(SignedIn::ended(app, headers));
    let mut silent_at = Instant::now() + settings.silent();
    let mut present_ms = app.clock.now_ms();
    loop {
        let has_room = feed.has_room();
        let heard = tokio::select! {
            biased;
            farewell = feed.over() => return Err(farewell.into()),
            () = &mut signed_out => return Err(Farewell::signed_out().into()),
            durable = &mut syncing, if !syncing.is_terminated() => {
                say(socket, &FromServer::Ack { durable: durable? }).await?;
                continue;
            }
            () = sleep_until(ack_at.unwrap_or(silent_at)), if ack_at.is_some() && syncing.is_terminated() => {
                ack_at = None;
                syncing.set(feed.begin_sync().await?.fuse());
                continue;
            }
            () = feed.room(), if !has_room => {
                silent_at = Instant::now() + settings.silent(); // the service did not read; the sender was not silent
                continue;
            }
            heard = next(socket), if has_room => heard?,
            () = ready(()), if feed.holds_back() => {
                feed.write().await?; // no further record has arrived yet
                continue;
            }
            () = sleep_until(silent_at), if has_room => {
                return Err(Farewell::new(Code::Silent, "nothing was heard for too long").into());
            }
        };
        silent_at = Instant::now() + settings.silent();
        feed.heard();
        match heard {
            Heard::Record(record) => {
                feed.take(record).await?;
                // A page that records sends no other requests, and must not be signed out as idle meanwhile.
                if app.clock.now_ms() - present_ms >= millis(PRESENT_EVERY) {
                    present_ms = app.clock.now_ms();
                    let _ = SignedIn::by(app, headers).await; // `signed_out` above checks whether the sign-in is valid
                }
                if ack_at.is_none() && feed.is_unsynced() {
                    ack_at = Some(Instant::now() + settings.ack());
                }
            }
            Heard::Word(FromSender::End { frames }) => {
                let answer = feed.end(frames).await?;
                say(socket, &answer).await?;
                if matches!(answer, FromServer::Ended { .. }) {
                    return Ok(());
                }
            }
            Heard::Word(FromSender::Hello(_)) => {
                return Err(Farewell::new(Code::NotUnderstood, "hello may be sent only once").into());
            }
            Heard::Sign => {}
        }
    }
}

/// A message from the sender.
enum Heard {
    Word(FromSender),
    Record(axum::body::Bytes),
    /// A ping or pong: the sender is still connected.
    Sign,
}

async fn next(socket: &mut WebSocket) -> Result<Heard, End> {
    match socket.recv().await {
        None | Some(Ok(Message::Close(_))) => Err(End::Gone),
        Some(Err(error)) => Err(cut_or_wrong(&error)),
        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(Heard::Sign),
        Some(Ok(Message::Binary(bytes))) => Ok(Heard::Record(bytes)),
        Some(Ok(Message::Text(text))) if text.len() > MOST_WORD => {
            let why = format!("a text message has {} bytes; at most {MOST_WORD} are accepted", text.len());
            Err(Farewell::new(Code::TooMuch, why).into())
        }
        Some(Ok(Message::Text(text))) => match serde_json::from_str(&text) {
            Ok(word) => Ok(Heard::Word(word)),
            Err(error) => {
                Err(Farewell::new(Code::NotUnderstood, format!("a text message is not understood: {error}")).into())
            }
        },
    }
}

/// A message that is too long is the sender's mistake; any other error is a lost connection.
fn cut_or_wrong(error: &axum::Error) -> End {
    let text = error.to_string();
    if text.contains("too long") || text.contains("too big") || text.contains("Space limit") {
        return Farewell::new(Code::TooMuch, format!("a message is longer than {MOST_BYTES} bytes")).into();
    }
    End::Gone
}

async fn say(socket: &mut WebSocket, message: &FromServer) -> Result<(), End> {
    let text = serde_json::to_string(message).unwrap_or_default(); // plain data always serialises
    match timeout(LAST_WORDS, socket.send(Message::Text(text.into()))).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) => Err(End::Gone),
        Err(_) => Err(Farewell::new(Code::Silent, "the sender does not read").into()),
    }
}
