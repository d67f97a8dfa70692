//! One conversation with the server, as `docs/feed.md` has it: records out, acknowledgements in, side by side.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::task::block_in_place;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::{HeaderValue, Uri, header};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_with_config};

use super::Agent;
use super::order::{Next, Order};
use crate::domain::feed::farewell::Code;
use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::record::{Body, GapReason, Record};
use crate::domain::feed::words::{FromSender, FromServer};
use crate::ids::{FeedId, SessionId};

/// How long a connection may take to come about.
const CONNECT: Duration = Duration::from_secs(10);
/// How long the server may be silent. It answers pings, but not while it puts a recording together.
const SILENCE: Duration = Duration::from_secs(30);
/// How long this end is silent at most; the protocol allows 20 s.
const PING_EVERY: Duration = Duration::from_secs(5);
/// Longest word of the server, bytes: 4096 ranges have less.
const MOST_WORD: usize = 1 << 18;
/// Read at once: what the service says is short, and each read clears this much first.
const READ_BYTES: usize = 4096;

type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// Where recordings go.
#[derive(Clone, Debug)]
pub struct Server {
    address: String,
    in_box: String,
    token_file: PathBuf,
}

/// How a conversation ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Parting {
    /// The recording is whole, and this session.
    Whole(SessionId),
    /// There was nothing to send, neither here nor there.
    Empty,
    /// It may go on later.
    Again {
        /// Why it ended.
        why: String,
        /// Was there a welcome?
        was_welcome: bool,
    },
    /// It will not go on by itself: why, and what to do.
    Refused(String),
}

impl Server {
    /// A box of a server at an address such as `https://trocar.example:8443`; the token is read whenever it is needed.
    ///
    /// # Errors
    /// The address is none, in words for people.
    pub fn new(address: &str, in_box: &str, token_file: &Path) -> Result<Self, String> {
        let expected =
            || format!("`{address}` is no server's address; expected http://HOST[:PORT] or https://HOST[:PORT]");
        let uri: Uri = address.parse().map_err(|_| expected())?;
        let scheme = match uri.scheme_str() {
            Some("http") => "ws",
            Some("https") => "wss",
            _ => return Err(expected()),
        };
        let host = uri.authority().filter(|host| !host.as_str().contains('@')).ok_or_else(expected)?;
        if in_box.is_empty() || !in_box.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b)) {
            return Err(format!("`{in_box}` is no box's code"));
        }
        let path = uri.path().trim_end_matches('/');
        let address = format!("{scheme}://{host}{path}/api/v1/boxes/{in_box}/feed");
        Ok(Self { address, in_box: in_box.to_owned(), token_file: token_file.to_owned() })
    }

    /// The box's code, or id.
    pub fn in_box(&self) -> &str {
        &self.in_box
    }

    /// Does everybody on the way read the token?
    pub fn is_open_to_all(&self) -> bool {
        let is_near = ["ws://127.", "ws://localhost", "ws://[::1]"].iter().any(|near| self.address.starts_with(near));
        self.address.starts_with("ws://") && !is_near
    }

    /// Connects, sends a recording, and returns when the connection ends.
    pub async fn converse(&self, agent: &Agent, id: FeedId) -> Parting {
        let recorded_in = agent.spool().get(id).and_then(|recording| recording.in_box.clone());
        if let Some(other) = recorded_in.filter(|in_box| *in_box != self.in_box) {
            let why = format!("it was recorded in the box {other}, and this is {}", self.in_box);
            return Parting::Refused(format!(
                "{why}: start the agent with `--box {other}` and that box's token to send it; if that box has another code today, \
                 write it into `{id}/box` in the spool"
            ));
        }
        match timeout(CONNECT, self.connect()).await {
            Ok(Ok(socket)) => Talk { agent, id, progress: Mutex::default() }.run(socket).await,
            Ok(Err(parting)) => parting,
            Err(_) => again(format!("no answer within {CONNECT:?}")),
        }
    }

    async fn connect(&self) -> Result<Socket, Parting> {
        let shown = self.token_file.display();
        let token = std::fs::read_to_string(&self.token_file)
            .map_err(|error| Parting::Refused(format!("the token cannot be read from {shown}: {error}")))?;
        let token = HeaderValue::from_str(&format!("Bearer {}", token.trim()))
            .map_err(|_| Parting::Refused(format!("{shown} holds no token")))?;
        let mut request = self.address.as_str().into_client_request().map_err(|error| again(error.to_string()))?;
        request.headers_mut().insert(header::AUTHORIZATION, token);
        let words = WebSocketConfig::default().max_message_size(Some(MOST_WORD)).max_frame_size(Some(MOST_WORD));
        let config = words.read_buffer_size(READ_BYTES);
        match connect_async_with_config(request, Some(config), true).await {
            Ok((socket, _)) => Ok(socket),
            Err(Error::Http(answer)) => Err(parting_at_the_door(answer.status().as_u16(), &shown.to_string())),
            Err(error) => Err(again(error.to_string())),
        }
    }
}

/// A conversation that has begun.
struct Talk<'a> {
    agent: &'a Agent,
    id: FeedId,
    progress: Mutex<Progress>,
}

#[derive(Default)]
struct Progress {
    order: Order,
    has_said_end: bool,
}

/// What the sending half does next.
enum Turn {
    Say(Message),
    Wait,
    Over(Parting),
}

impl Talk<'_> {
    async fn run(&self, socket: Socket) -> Parting {
        let (mut sink, mut stream) = socket.split();
        let Some(hello) = self.agent.spool().get(self.id).map(|recording| recording.hello.clone()) else {
            return Parting::Empty;
        };
        if let Err(error) = sink.send(word(&FromSender::Hello(hello))).await {
            return again(error.to_string());
        }
        let epoch = match hear(&mut stream).await {
            Ok(FromServer::Welcome { epoch, durable, .. }) => {
                self.acknowledged(durable);
                epoch
            }
            Ok(FromServer::Ended { session, .. }) => return Parting::Whole(session),
            Ok(_) => return again("the server answers what was not asked".into()),
            Err(parting) => return parting,
        };
        self.agent.status().connected();
        tracing::info!(recording = %self.id, epoch, "connected");
        let parting = tokio::select! {
            parting = self.listen(&mut stream) => parting,
            parting = self.send(&mut sink, epoch) => parting,
        };
        match parting {
            Parting::Again { why, .. } => Parting::Again { why, was_welcome: true },
            other => other,
        }
    }

    async fn listen(&self, stream: &mut SplitStream<Socket>) -> Parting {
        loop {
            match hear(stream).await {
                Ok(FromServer::Ack { durable }) => self.acknowledged(durable),
                Ok(FromServer::Missing { frames }) => {
                    let mut progress = self.progress();
                    progress.order.asked(frames);
                    progress.has_said_end = false;
                }
                Ok(FromServer::Ended { session, .. }) => return Parting::Whole(session),
                Ok(FromServer::Welcome { .. }) => {}
                Err(parting) => return parting,
            }
            self.agent.has_changed();
        }
    }

    async fn send(&self, sink: &mut SplitSink<Socket, Message>, epoch: u32) -> Parting {
        loop {
            let sent = match block_in_place(|| self.turn(epoch)) {
                Turn::Say(message) => sink.send(message).await,
                Turn::Over(parting) => return parting,
                Turn::Wait => match timeout(PING_EVERY, self.agent.0.changed.notified()).await {
                    Ok(()) => Ok(()),
                    Err(_) => sink.send(Message::Ping(Vec::new().into())).await,
                },
            };
            if sent.is_err() {
                // Why is heard by the other half, if the server said so.
                tokio::time::sleep(SILENCE).await;
                return again("the connection was cut".into());
            }
        }
    }

    fn turn(&self, epoch: u32) -> Turn {
        let mut spool = self.agent.spool();
        let is_live = spool.live() == Some(self.id);
        let mut progress = self.progress();
        loop {
            let Some(recording) = spool.get(self.id) else { return Turn::Over(Parting::Empty) };
            match progress.order.next(recording, is_live) {
                Some(Next::Record(entry)) => {
                    if let Some(bytes) = spool.read(self.id, entry)
                        && let Ok(record) = Record::read(&bytes)
                    {
                        return Turn::Say(message(&Record { epoch, ..record }));
                    }
                }
                Some(Next::Lost([number, last])) => {
                    let body = Body::Gap { last, reason: GapReason::SenderStopped };
                    return Turn::Say(message(&Record { epoch, number, body }));
                }
                None if is_live || progress.has_said_end || !progress.order.is_done(recording) => return Turn::Wait,
                // What lies in some buffer on the way may yet be lost: the end is that of what the server has.
                None if !recording.is_acknowledged() => return Turn::Wait,
                None if recording.end == 0 => return Turn::Over(Parting::Empty),
                None => {
                    let frames = recording.end;
                    if let Err(error) = spool.close(self.id) {
                        return Turn::Over(again(format!("the spool cannot be written: {error}")));
                    }
                    progress.has_said_end = true;
                    return Turn::Say(word(&FromSender::End { frames }));
                }
            }
        }
    }

    fn acknowledged(&self, durable: Vec<[u64; 2]>) {
        let mut numbers = Numbers::default();
        // A server that acknowledges in more pieces than the protocol allows is sent the rest again.
        let _ = durable.iter().try_for_each(|[first, last]| numbers.add(*first, *last));
        self.progress().order.acknowledged(&numbers);
        self.agent.status().acknowledged = numbers.ranges().iter().map(|[first, last]| last - first + 1).sum();
        if let Err(error) = block_in_place(|| self.agent.spool().acknowledge(self.id, numbers)) {
            tracing::warn!(%error, "what the server has cannot be removed from the spool");
        }
    }

    fn progress(&self) -> std::sync::MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The server's next word, or how it parted.
async fn hear(stream: &mut SplitStream<Socket>) -> Result<FromServer, Parting> {
    loop {
        match timeout(SILENCE, stream.next()).await {
            Err(_) => return Err(again(format!("nothing was heard for {SILENCE:?}"))),
            Ok(None) => return Err(again("the connection was cut".into())),
            Ok(Some(Err(error))) => return Err(again(error.to_string())),
            Ok(Some(Ok(Message::Text(text)))) => {
                return serde_json::from_str(&text).map_err(|error| again(format!("a word not understood: {error}")));
            }
            Ok(Some(Ok(Message::Close(frame)))) => {
                let (code, why) = frame.map_or((1005, String::new()), |f| (f.code.into(), f.reason.to_string()));
                return Err(parting_by_code(code, &why));
            }
            Ok(Some(Ok(_))) => {}
        }
    }
}

fn message(record: &Record<'_>) -> Message {
    let mut bytes = Vec::with_capacity(record.bytes());
    record.write(&mut bytes);
    Message::binary(bytes)
}

fn word(word: &FromSender) -> Message {
    Message::text(serde_json::to_string(word).unwrap_or_default()) // plain data
}

fn again(why: String) -> Parting {
    Parting::Again { why, was_welcome: false }
}

/// What a close code asks for: the last column of its table in `docs/feed.md`.
fn parting_by_code(number: u16, why: &str) -> Parting {
    let what_to_do = match Code::ALL.into_iter().find(|code| code.number() == number) {
        None | Some(Code::Done | Code::Ending | Code::Silent | Code::Busy | Code::Failed) => {
            return again(format!("{why} ({number})"));
        }
        Some(Code::SignedOut) => "put a new token into the token file and start the agent again",
        Some(Code::Unknown) => {
            "make the box, trainee or task on the server, or name another, and start the agent again"
        }
        Some(Code::Superseded) => "see that no other agent sends this recording",
        Some(Code::TooMuch | Code::DoesNotBelong) => "the server takes no more of this recording; begin another",
        Some(Code::NotUnderstood) => "see that agent and server are of one version",
    };
    Parting::Refused(format!("{why} ({number}): {what_to_do}"))
}

/// What an answer asks for that came instead of a connection.
fn parting_at_the_door(status: u16, token_file: &str) -> Parting {
    match status {
        401 => Parting::Refused(format!("the token in {token_file} does not count: put a new one there (401)")),
        403 => Parting::Refused(format!("the token in {token_file} may not send recordings of this box (403)")),
        404 => Parting::Refused("the token knows no such box, or the address leads elsewhere (404)".into()),
        400..500 if status != 408 && status != 429 => {
            Parting::Refused(format!("the server refuses with status {status}"))
        }
        _ => again(format!("the server is busy (status {status})")),
    }
}

#[cfg(test)]
mod tests;
