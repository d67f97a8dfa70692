//! Limits on the streams of an HTTP/2 connection. HTTP/1.1 has a timer for each of them; HTTP/2 needs its own:
//!
//! - A connection without an open stream ends after the time that a request's head may take
//!   ([`StreamExecutor::idle_for`]).
//! - A stream whose client does not read the answer is reset. Its window is closed, so nothing is written that
//!   [`StallGuard`](super::stall::StallGuard) could see, and the other streams of the connection go on: a browser
//!   pauses a video for minutes and reads events meanwhile.

use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::response::Response;
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use hyper::rt::Executor;
use tokio::sync::watch;
use tokio::time::{Instant, interval, timeout_at};

/// Most streams that a client may have open. Browsers keep further requests waiting, and need few for long: one for
/// events, one for each video. A stream takes about 40 KiB, so a stranger gets about 1 MiB for a connection, and the
/// connections are limited ([`max_connections`](super::settings::HttpSettings::max_connections)).
pub const MAX_STREAMS: u32 = 32;
/// Most bytes of an answer that wait for the client, for each stream. hyper's own limit is 400 kB.
pub const MAX_UNSENT_BYTES: usize = 64 << 10;

tokio::task_local! {
    /// The answer of the stream that the current task serves.
    static ANSWER: Arc<AnswerProgress>;
}

/// Runs the streams of one connection. Clones belong to the same connection.
#[derive(Clone, Debug)]
pub struct StreamExecutor {
    streams: watch::Sender<OpenStreams>,
    write_timeout: Duration,
}

#[derive(Clone, Copy, Debug)]
struct OpenStreams {
    count: usize,
    /// When the last stream ended, or the connection began.
    idle_since: Instant,
}

impl StreamExecutor {
    /// For a connection that begins now. A client may leave an answer unread for `write_timeout`.
    pub fn new(write_timeout: Duration) -> Self {
        let none = OpenStreams { count: 0, idle_since: Instant::now() };
        Self { streams: watch::Sender::new(none), write_timeout }
    }

    /// Waits until the connection has had no open stream for `limit`.
    pub async fn idle_for(&self, limit: Duration) {
        let mut changes = self.streams.subscribe();
        loop {
            // Cannot fail: `self` holds the sender.
            let idle_since = match changes.wait_for(|streams| streams.count == 0).await {
                Ok(streams) => streams.idle_since,
                Err(_) => return,
            };
            if timeout_at(idle_since + limit, changes.changed()).await.is_err() {
                return;
            }
        }
    }
}

impl<F> Executor<F> for StreamExecutor
where
    F: Future + Send + 'static,
    F::Output: Send,
{
    fn execute(&self, stream: F) {
        let open = OpenStream::new(self.streams.clone());
        let (answer, limit) = (Arc::<AnswerProgress>::default(), self.write_timeout);
        tokio::spawn(ANSWER.scope(answer.clone(), async move {
            tokio::select! {
                _ = stream => {}
                () = answer.unread_for(limit) => tracing::debug!("stream reset: the client does not read the answer"),
            }
            drop(open);
        }));
    }
}

/// Counts one open stream, until dropped.
struct OpenStream(watch::Sender<OpenStreams>);

impl OpenStream {
    fn new(streams: watch::Sender<OpenStreams>) -> Self {
        streams.send_modify(|streams| streams.count += 1);
        Self(streams)
    }
}

impl Drop for OpenStream {
    fn drop(&mut self) {
        self.0.send_modify(|streams| {
            streams.count -= 1;
            streams.idle_since = Instant::now();
        });
    }
}

/// Whether the client reads an answer.
#[derive(Debug, Default)]
struct AnswerProgress {
    /// Since when a piece of the answer waits to be sent; `None` while the client waits for the service.
    unread_since: Mutex<Option<Instant>>,
}

impl AnswerProgress {
    fn set(&self, unread_since: Option<Instant>) {
        *self.unread_since.lock().unwrap_or_else(PoisonError::into_inner) = unread_since;
    }

    fn unread_since(&self) -> Option<Instant> {
        *self.unread_since.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the client has read nothing for `limit`.
    async fn unread_for(&self, limit: Duration) {
        let mut looks = interval((limit / 4).max(Duration::from_millis(1)));
        loop {
            looks.tick().await;
            if self.unread_since().is_some_and(|since| since.elapsed() >= limit) {
                return;
            }
        }
    }
}

/// Lets the stream that sends this answer notice that its client does not read. Has no effect with HTTP/1.1.
pub fn watch_answer(answer: Response) -> Response {
    match ANSWER.try_with(Arc::clone) {
        Ok(progress) => answer.map(|body| Body::new(WatchedBody { body, rest: Bytes::new(), progress })),
        Err(_) => answer,
    }
}

/// A body in pieces of at most [`MAX_UNSENT_BYTES`]. hyper takes the next piece when the client's window is open.
struct WatchedBody {
    body: Body,
    /// The rest of a longer piece.
    rest: Bytes,
    progress: Arc<AnswerProgress>,
}

impl HttpBody for WatchedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let this = &mut *self;
        if this.rest.is_empty() {
            match Pin::new(&mut this.body).poll_frame(cx) {
                Poll::Ready(Some(Ok(frame))) => match frame.into_data() {
                    Ok(data) => this.rest = data,
                    Err(trailers) => return Poll::Ready(Some(Ok(trailers))),
                },
                other => {
                    this.progress.set(None);
                    return other;
                }
            }
        }
        let piece = this.rest.split_to(this.rest.len().min(MAX_UNSENT_BYTES));
        this.progress.set(Some(Instant::now()));
        Poll::Ready(Some(Ok(Frame::data(piece))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (of_body, rest) = (self.body.size_hint(), self.rest.len() as u64);
        let mut hint = SizeHint::new();
        hint.set_lower(of_body.lower() + rest);
        if let Some(upper) = of_body.upper() {
            hint.set_upper(upper + rest);
        }
        hint
    }
}

#[cfg(test)]
mod tests {
    use http_body_util::BodyExt;

    use super::*;

    const LIMIT: Duration = Duration::from_millis(20);

    fn watched(content: Vec<u8>) -> (WatchedBody, Arc<AnswerProgress>) {
        let progress = Arc::<AnswerProgress>::default();
        (WatchedBody { body: Body::from(content), rest: Bytes::new(), progress: progress.clone() }, progress)
    }

    #[tokio::test]
    async fn a_long_answer_arrives_whole_and_in_pieces() {
        let content: Vec<u8> = (0..3 * MAX_UNSENT_BYTES + 5).map(|at| at as u8).collect();
        let (mut body, progress) = watched(content.clone());
        let mut received = Vec::new();
        while let Some(frame) = body.frame().await {
            assert_eq!(
                body.size_hint().exact(),
                Some(
                    (content.len() - received.len()) as u64
                        - MAX_UNSENT_BYTES.min(content.len() - received.len()) as u64
                )
            );
            let data = frame.unwrap().into_data().unwrap();
            assert!(data.len() <= MAX_UNSENT_BYTES);
            received.extend_from_slice(&data);
        }
        assert_eq!(received, content);
        assert_eq!(progress.unread_since(), None, "the client has taken all of it");
    }

    #[tokio::test]
    async fn only_a_client_that_leaves_a_piece_unread_is_overdue() {
        let (mut body, progress) = watched(vec![0; MAX_UNSENT_BYTES + 1]);
        let overdue = tokio::time::timeout(3 * LIMIT, progress.unread_for(LIMIT)).await;
        assert!(overdue.is_err(), "the client waits for the service");
        body.frame().await.unwrap().unwrap();
        progress.unread_for(LIMIT).await;
    }

    #[tokio::test]
    async fn a_connection_is_idle_once_its_last_stream_has_ended() {
        let executor = StreamExecutor::new(Duration::from_secs(60));
        executor.idle_for(LIMIT).await;
        let (end, ended) = tokio::sync::oneshot::channel::<()>();
        executor.execute(async move { drop(ended.await) });
        assert!(tokio::time::timeout(3 * LIMIT, executor.idle_for(LIMIT)).await.is_err());
        end.send(()).unwrap();
        executor.idle_for(LIMIT).await;
    }
}
