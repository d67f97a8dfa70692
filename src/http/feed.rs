//! A box's feed over WebSocket, as `docs/feed.md` has it: words in text messages, records in binary ones.
//!
//! One task for each connection, and nothing waits in it: a record is read, appended, forgotten. What came is made durable
//! beside that. While nothing can be written nothing is read, and the sender is held up by its own socket.

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

/// Longest word, bytes.
const MOST_WORD: usize = 8192;
/// What one read of the socket takes at most: a frame of 8 Mbit/s and more. Much less is a system call for each few
/// kilobytes; each of the boxes that may send at a time has so much memory of its own.
const READ_BYTES: usize = 64 << 10;
/// How long a sender may take to hear the last words.
const LAST_WORDS: Duration = Duration::from_secs(5);
/// How often a sender of frames counts as somebody who is there.
const PRESENT_EVERY: Duration = Duration::from_secs(60);
/// How long a hello may take to come.
const HELLO: Duration = Duration::from_secs(10);

/// Send a box's frames as they are recorded
///
/// A WebSocket; `docs/feed.md` describes what is said on it. For the box's agent, and for people who may send recordings.
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
        Refusal::BadRequest.with("This is a WebSocket: open it as one. docs/feed.md describes what is said on it.")
    })?;
    origin::refuse_foreign(&headers)?;
    let in_box = Key::from(&in_box);
    app.store.boxes().get(&by.scope, &in_box).await?;
    let full = |_| busy("Too many boxes send at once. Try again when one of them has ended.");
    let place = app.feed_places.clone().try_acquire_owned().map_err(full)?;
    let by = By { scope: by.scope, headers };
    let upgrade = upgrade
        .max_message_size(MOST_BYTES)
        .max_frame_size(MOST_BYTES)
        .read_buffer_size(READ_BYTES)
        .write_buffer_size(0)
        .max_write_buffer_size(1 << 17);
    Ok(upgrade.on_upgrade(move |socket| async move {
        // Counted among what the service ends before it is gone.
        let talk = app.shutdown.spawn(talk(app.clone(), by, in_box, socket));
        let _ = talk.await; // a panic is logged where it happened
        drop(place);
    }))
}

/// Who sends, and what shows it.
struct By {
    scope: Scope,
    headers: HeaderMap,
}

/// The whole conversation, and the reason at its end.
async fn talk(app: App, by: By, in_box: Key, mut socket: WebSocket) {
    let farewell = match converse(&app, &by, &in_box, &mut socket).await {
        Ok(()) => Farewell::new(Code::Done, "the recording is whole"),
        Err(End::Gone) => return tracing::debug!(in_box = in_box.as_str(), "a feed's connection was cut"),
        Err(End::Told(farewell)) => farewell,
    };
    if farewell.code == Code::Done {
        tracing::info!(in_box = in_box.as_str(), "a feed has ended");
    } else {
        tracing::warn!(in_box = in_box.as_str(), code = farewell.code.number(), why = farewell.why, "a feed is closed");
    }
    let frame = CloseFrame { code: farewell.code.number(), reason: farewell.short().into() };
    let _ = timeout(LAST_WORDS, socket.send(Message::Close(Some(frame)))).await; // whoever does not listen misses it
}

/// Why a conversation ended before the recording was whole.
enum End {
    /// The sender has gone.
    Gone,
    /// The sender is told.
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
        word = timeout(HELLO, next(socket)) => match word {
            Ok(word) => word?,
            Err(_) => return Err(Farewell::new(Code::Silent, "no hello came").into()),
        },
        () = app.shutdown.begun() => return Err(Farewell::service_ends().into()),
    };
    let Heard::Word(FromSender::Hello(hello)) = hello else {
        return Err(Farewell::new(Code::NotUnderstood, "the first word of a connection is hello").into());
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
                silent_at = Instant::now() + settings.silent(); // it was we who did not listen
                continue;
            }
            heard = next(socket), if has_room => heard?,
            () = ready(()), if feed.holds_back() => {
                feed.write().await?; // no more is at hand
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
                // A page that records asks for nothing else meanwhile, and must not end as if nobody sat in front of it.
                if app.clock.now_ms() - present_ms >= millis(PRESENT_EVERY) {
                    present_ms = app.clock.now_ms();
                    let _ = SignedIn::by(app, headers).await; // whether it still counts is looked at beside this
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
                return Err(Farewell::new(Code::NotUnderstood, "hello is said once").into());
            }
            Heard::Sign => {}
        }
    }
}

/// What a sender sent.
enum Heard {
    Word(FromSender),
    Record(axum::body::Bytes),
    /// A ping or pong: it is there.
    Sign,
}

async fn next(socket: &mut WebSocket) -> Result<Heard, End> {
    match socket.recv().await {
        None | Some(Ok(Message::Close(_))) => Err(End::Gone),
        Some(Err(error)) => Err(cut_or_wrong(&error)),
        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(Heard::Sign),
        Some(Ok(Message::Binary(bytes))) => Ok(Heard::Record(bytes)),
        Some(Ok(Message::Text(text))) if text.len() > MOST_WORD => {
            Err(Farewell::new(Code::TooMuch, format!("a word of {} bytes; at most {MOST_WORD}", text.len())).into())
        }
        Some(Ok(Message::Text(text))) => match serde_json::from_str(&text) {
            Ok(word) => Ok(Heard::Word(word)),
            Err(error) => {
                Err(Farewell::new(Code::NotUnderstood, format!("a word that is not understood: {error}")).into())
            }
        },
    }
}

/// A message that is too long is the sender's mistake; anything else is a cut.
fn cut_or_wrong(error: &axum::Error) -> End {
    let text = error.to_string();
    if text.contains("too long") || text.contains("too big") || text.contains("Space limit") {
        return Farewell::new(Code::TooMuch, format!("a message is longer than {MOST_BYTES} bytes")).into();
    }
    End::Gone
}

async fn say(socket: &mut WebSocket, word: &FromServer) -> Result<(), End> {
    let text = serde_json::to_string(word).unwrap_or_default(); // plain data
    match timeout(LAST_WORDS, socket.send(Message::Text(text.into()))).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) => Err(End::Gone),
        Err(_) => Err(Farewell::new(Code::Silent, "the sender does not listen").into()),
    }
}
