//! One connection to the server, as described in `docs/feed.md`: sends records and receives acknowledgements at the
//! same time.

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
use super::send_order::{NextSend, SendOrder};
use crate::domain::feed::close_reason::CloseCode;
use crate::domain::feed::messages::{SenderMessage, ServerMessage};
use crate::domain::feed::numbers::FrameNumbers;
use crate::domain::feed::record::{FeedRecord, GapReason, RecordBody};
use crate::ids::{FeedId, SessionId};
use crate::time::{Clock, SystemClock, to_rfc3339};

/// Longest time to establish a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest silence of the server. It answers pings, but not while it assembles a recording.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(30);
/// Interval between pings when there is nothing to send; the protocol allows 20 s of silence.
const PING_INTERVAL: Duration = Duration::from_secs(5);
/// Longest message from the server, bytes: 4096 ranges need less.
const MAX_MESSAGE_BYTES: usize = 1 << 18;
/// Read buffer, bytes: the server's messages are short, and each read first clears the whole buffer.
const READ_BYTES: usize = 4096;

pub(super) type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// The server that receives the recordings.
#[derive(Clone, Debug)]
pub struct Server {
    /// Address of the box in the API, for WebSockets.
    address: String,
    in_box: String,
    token_file: PathBuf,
}

/// How a connection ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DisconnectOutcome {
    /// The recording is complete and is this session.
    Complete(SessionId),
    /// There was nothing to send, here or on the server.
    Empty,
    /// Try again later.
    Retry {
        /// Why the connection ended.
        why: String,
        /// True if the server had sent a welcome.
        was_welcome: bool,
    },
    /// Sending cannot continue without help: why, and what to do.
    Refused(String),
}

impl Server {
    /// A box of a server at an address such as `https://trocar.example:8443`. The token is read at each connection.
    ///
    /// # Errors
    /// The address or the box is invalid; the text is for users.
    pub fn new(address: &str, in_box: &str, token_file: &Path) -> Result<Self, String> {
        let expected =
            || format!("`{address}` is not a server address; expected http://HOST[:PORT] or https://HOST[:PORT]");
        let uri: Uri = address.parse().map_err(|_| expected())?;
        let scheme = match uri.scheme_str() {
            Some("http") => "ws",
            Some("https") => "wss",
            _ => return Err(expected()),
        };
        let host = uri.authority().filter(|host| !host.as_str().contains('@')).ok_or_else(expected)?;
        if in_box.is_empty() || !in_box.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b)) {
            return Err(format!("`{in_box}` is not the code of a box"));
        }
        let path = uri.path().trim_end_matches('/');
        let address = format!("{scheme}://{host}{path}/api/v1/boxes/{in_box}");
        Ok(Self { address, in_box: in_box.to_owned(), token_file: token_file.to_owned() })
    }

    /// Code or id of the box.
    pub fn in_box(&self) -> &str {
        &self.in_box
    }

    /// True if the token travels unencrypted over a network.
    pub fn is_unencrypted(&self) -> bool {
        let is_near = ["ws://127.", "ws://localhost", "ws://[::1]"].iter().any(|near| self.address.starts_with(near));
        self.address.starts_with("ws://") && !is_near
    }

    /// Connects, sends a recording, and returns when the connection ends.
    pub async fn run(&self, agent: &Agent, id: FeedId) -> DisconnectOutcome {
        if let Some(why) = self.why_not_of_this_box(agent, id) {
            return DisconnectOutcome::Refused(why);
        }
        match self.connect_in_time("feed").await {
            Ok(socket) => FeedConnection { agent, id, progress: Mutex::default() }.run(socket).await,
            Err(outcome) => outcome,
        }
    }

    /// Why a recording cannot be sent for this box: it was made for another one.
    pub(super) fn why_not_of_this_box(&self, agent: &Agent, id: FeedId) -> Option<String> {
        let recorded_in = agent.spool().get(id).and_then(|recording| recording.in_box.clone());
        let other = recorded_in.filter(|in_box| *in_box != self.in_box)?;
        let why = format!("the recording belongs to the box {other}, but the agent runs for the box {}", self.in_box);
        Some(format!(
            "{why}: to send it, start the agent with `--box {other}` and that box's token; if that box has a new code, \
             write the new code into `{id}/box` in the spool"
        ))
    }

    /// Connects as an agent that stands by would, and ends the connection before its first message: an agent that is
    /// connected notices nothing. Returns what is wrong; `None`: nothing.
    pub async fn check(&self) -> Option<DisconnectOutcome> {
        self.connect_in_time("agent-connection").await.err()
    }

    /// Connects to a WebSocket of the box, within a limited time.
    pub(super) async fn connect_in_time(&self, what: &str) -> Result<Socket, DisconnectOutcome> {
        let silent = |_| Err(retry(format!("no answer within {CONNECT_TIMEOUT:?}")));
        timeout(CONNECT_TIMEOUT, self.connect(what)).await.unwrap_or_else(silent)
    }

    async fn connect(&self, what: &str) -> Result<Socket, DisconnectOutcome> {
        let shown = self.token_file.display();
        let token = std::fs::read_to_string(&self.token_file)
            .map_err(|error| DisconnectOutcome::Refused(format!("the token cannot be read from {shown}: {error}")))?;
        let token = HeaderValue::from_str(&format!("Bearer {}", token.trim()))
            .map_err(|_| DisconnectOutcome::Refused(format!("{shown} contains no valid token")))?;
        let address = format!("{}/{what}", self.address);
        let mut request = address.as_str().into_client_request().map_err(|error| retry(error.to_string()))?;
        request.headers_mut().insert(header::AUTHORIZATION, token);
        let words = WebSocketConfig::default()
            .max_message_size(Some(MAX_MESSAGE_BYTES))
            .max_frame_size(Some(MAX_MESSAGE_BYTES));
        let config = words.read_buffer_size(READ_BYTES);
        match connect_async_with_config(request, Some(config), true).await {
            Ok((socket, _)) => Ok(socket),
            Err(Error::Http(response)) => Err(outcome_of_http_status(response.status().as_u16(), &shown.to_string())),
            Err(error) => Err(retry(why_not_connected(&error))),
        }
    }
}

/// A connection to the server.
struct FeedConnection<'a> {
    agent: &'a Agent,
    id: FeedId,
    progress: Mutex<SendProgress>,
}

#[derive(Default)]
struct SendProgress {
    order: SendOrder,
    has_sent_end: bool,
}

/// What the sending half does next.
enum NextAction {
    Send(Message),
    Wait,
    Close(DisconnectOutcome),
}

impl FeedConnection<'_> {
    async fn run(&self, socket: Socket) -> DisconnectOutcome {
        let (mut sink, mut stream) = socket.split();
        let Some(hello) = self.agent.spool().get(self.id).map(|recording| recording.hello.clone()) else {
            return DisconnectOutcome::Empty;
        };
        if let Err(error) = sink.send(text_message(&SenderMessage::Hello(hello))).await {
            return retry(error.to_string());
        }
        let epoch = match receive(&mut stream).await {
            Ok(ServerMessage::Welcome { session, epoch, durable, token_expires_at }) => {
                self.handle_ack(durable);
                self.agent.0.accepted.send_replace(Some((self.id, session)));
                if let Some(expires_at) = token_expires_at {
                    tracing::warn!(expires_at, "the token expires soon: make another and put it into the token file");
                }
                epoch
            }
            Ok(ServerMessage::Ended { session, .. }) => return DisconnectOutcome::Complete(session),
            Ok(_) => return retry("the server sent an unexpected message".into()),
            Err(outcome) => return outcome,
        };
        self.agent.status().connected();
        tracing::info!(recording = %self.id, epoch, "connected");
        let outcome = tokio::select! {
            outcome = self.receive_all(&mut stream) => outcome,
            outcome = self.send_all(&mut sink, epoch) => outcome,
        };
        match outcome {
            DisconnectOutcome::Retry { why, .. } => DisconnectOutcome::Retry { why, was_welcome: true },
            other => other,
        }
    }

    async fn receive_all(&self, stream: &mut SplitStream<Socket>) -> DisconnectOutcome {
        loop {
            match receive(stream).await {
                Ok(ServerMessage::Ack { durable }) => self.handle_ack(durable),
                Ok(ServerMessage::Missing { frames }) => {
                    let mut progress = self.progress();
                    progress.order.request_missing(frames);
                    progress.has_sent_end = false;
                }
                Ok(ServerMessage::Ended { session, .. }) => return DisconnectOutcome::Complete(session),
                Ok(ServerMessage::Welcome { .. }) => {}
                Err(outcome) => return outcome,
            }
            self.agent.notify_changed();
        }
    }

    async fn send_all(&self, sink: &mut SplitSink<Socket, Message>, epoch: u32) -> DisconnectOutcome {
        loop {
            let sent = match block_in_place(|| self.next_action(epoch)) {
                NextAction::Send(message) => sink.send(message).await,
                NextAction::Close(outcome) => return outcome,
                NextAction::Wait => match timeout(PING_INTERVAL, self.agent.0.changed.notified()).await {
                    Ok(()) => Ok(()),
                    Err(_) => sink.send(Message::Ping(Vec::new().into())).await,
                },
            };
            if sent.is_err() {
                // The receiving half reports why, if the server sent a reason.
                tokio::time::sleep(SILENCE_TIMEOUT).await;
                return retry("the connection was cut".into());
            }
        }
    }

    fn next_action(&self, epoch: u32) -> NextAction {
        let mut spool = self.agent.spool();
        let is_live = spool.live() == Some(self.id);
        let mut progress = self.progress();
        loop {
            let Some(recording) = spool.get(self.id) else { return NextAction::Close(DisconnectOutcome::Empty) };
            match progress.order.next(recording, is_live) {
                Some(NextSend::Record(entry)) => {
                    if let Some(bytes) = spool.read(self.id, entry)
                        && let Ok(record) = FeedRecord::read(&bytes)
                    {
                        return NextAction::Send(record_message(&FeedRecord { epoch, ..record }));
                    }
                }
                Some(NextSend::Lost([number, last])) => {
                    let body = RecordBody::Gap { last, reason: GapReason::SenderStopped };
                    return NextAction::Send(record_message(&FeedRecord { epoch, number, body }));
                }
                None if is_live || progress.has_sent_end || !progress.order.is_done(recording) => {
                    return NextAction::Wait;
                }
                // Frames in buffers on the way may still be lost, so the end is sent only when the server has
                // everything.
                None if !recording.is_acknowledged() => return NextAction::Wait,
                None if recording.end == 0 => return NextAction::Close(DisconnectOutcome::Empty),
                None => {
                    let (frames, source_lost) = (recording.end, recording.source_lost.clone());
                    let broken_off = recording.broken_off.clone();
                    if let Err(error) = spool.close(self.id) {
                        return NextAction::Close(retry(format!("the spool cannot be written: {error}")));
                    }
                    progress.has_sent_end = true;
                    return NextAction::Send(text_message(&SenderMessage::End { frames, source_lost, broken_off }));
                }
            }
        }
    }

    fn handle_ack(&self, durable: Vec<[u64; 2]>) {
        let mut numbers = FrameNumbers::default();
        // A server that acknowledges in more ranges than the protocol allows receives the rest again.
        let _ = durable.iter().try_for_each(|[first, last]| numbers.add(*first, *last));
        self.progress().order.apply_ack(&numbers);
        self.agent.status().acknowledged = numbers.ranges().iter().map(|[first, last]| last - first + 1).sum();
        if let Err(error) = block_in_place(|| self.agent.spool().acknowledge(self.id, numbers)) {
            tracing::warn!(%error, "acknowledged frames cannot be removed from the spool; it keeps growing");
        }
    }

    fn progress(&self) -> std::sync::MutexGuard<'_, SendProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The server's next message, or how the connection ended.
async fn receive(stream: &mut SplitStream<Socket>) -> Result<ServerMessage, DisconnectOutcome> {
    loop {
        match timeout(SILENCE_TIMEOUT, stream.next()).await {
            Err(_) => return Err(retry(format!("the server was silent for {SILENCE_TIMEOUT:?}"))),
            Ok(None) => return Err(retry("the connection was cut".into())),
            Ok(Some(Err(error))) => return Err(retry(error.to_string())),
            Ok(Some(Ok(Message::Text(text)))) => {
                return serde_json::from_str(&text)
                    .map_err(|error| retry(format!("the server sent an unreadable message: {error}")));
            }
            Ok(Some(Ok(Message::Close(frame)))) => {
                let (code, why) = frame.map_or((1005, String::new()), |f| (f.code.into(), f.reason.to_string()));
                return Err(outcome_of_close_code(code, &why));
            }
            Ok(Some(Ok(_))) => {}
        }
    }
}

fn record_message(record: &FeedRecord<'_>) -> Message {
    let mut bytes = Vec::with_capacity(record.bytes());
    record.write(&mut bytes);
    Message::binary(bytes)
}

fn text_message(word: &SenderMessage) -> Message {
    Message::text(serde_json::to_string(word).unwrap_or_default()) // cannot fail: plain data
}

/// Why there is no connection. A certificate that does not hold at this computer's time says more of its clock.
fn why_not_connected(error: &Error) -> String {
    use rustls::CertificateError::{Expired, ExpiredContext, NotValidYet, NotValidYetContext};
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(error);
    while let Some(at) = cause {
        let inner = at.downcast_ref::<std::io::Error>().and_then(std::io::Error::get_ref);
        let tls = at.downcast_ref().or(inner.and_then(|inner| inner.downcast_ref::<rustls::Error>()));
        if let Some(rustls::Error::InvalidCertificate(
            Expired | ExpiredContext { .. } | NotValidYet | NotValidYetContext { .. },
        )) = tls
        {
            let shown = to_rfc3339(SystemClock.now_ms());
            return format!(
                "the server's certificate does not hold at the time of this computer, {shown}: set the clock of this \
                 computer if it is wrong, or renew the certificate ({error})"
            );
        }
        cause = at.source();
    }
    error.to_string()
}

/// True if two reasons for a lost connection differ in no more than their figures, such as a time.
pub(super) fn is_same_reason(one: &str, other: &str) -> bool {
    let words = |text: &str| text.chars().filter(|c| !c.is_ascii_digit()).collect::<String>();
    words(one) == words(other)
}

fn retry(why: String) -> DisconnectOutcome {
    DisconnectOutcome::Retry { why, was_welcome: false }
}

/// What to do after this close code: the last column of its table in `docs/feed.md`.
pub(super) fn outcome_of_close_code(number: u16, why: &str) -> DisconnectOutcome {
    let advice = match CloseCode::ALL.into_iter().find(|code| code.number() == number) {
        None
        | Some(
            CloseCode::Done | CloseCode::ServiceStopping | CloseCode::Silent | CloseCode::Busy | CloseCode::Failed,
        ) => {
            return retry(format!("{why} ({number})"));
        }
        Some(CloseCode::SignedOut) => "put a new token into the token file and restart the agent",
        Some(CloseCode::Unknown) => {
            "create the box, trainee or task on the server, or name another one, and restart the agent. If it was erased \
             there, delete the recording"
        }
        Some(CloseCode::Superseded) => "check that no other agent sends this recording",
        Some(CloseCode::TooLarge | CloseCode::OutOfPlace) => {
            "the server accepts no more of this recording; start a new one"
        }
        Some(CloseCode::NotUnderstood) => "install the same version of agent and server",
    };
    DisconnectOutcome::Refused(format!("{why} ({number}): {advice}"))
}

/// What to do after this HTTP status in place of a connection.
fn outcome_of_http_status(status: u16, token_file: &str) -> DisconnectOutcome {
    match status {
        401 => DisconnectOutcome::Refused(format!(
            "the token in {token_file} is not valid: it has expired, was withdrawn, or is of another server; make a new \
             one for the box and put it there (401)"
        )),
        403 => DisconnectOutcome::Refused(format!(
            "the token in {token_file} may not send recordings of this box: use one of a box's agent (403)"
        )),
        404 => DisconnectOutcome::Refused(
            "the token is of another box, no box has this code, or the address is wrong: compare box and address with \
             the page Boxes (404)"
                .into(),
        ),
        400..500 if status != 408 && status != 429 => {
            DisconnectOutcome::Refused(format!("the server refused the connection with status {status}"))
        }
        _ => retry(format!("the server is busy (status {status})")),
    }
}

#[cfg(test)]
mod tests;
