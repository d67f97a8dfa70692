//! Enforces a minimum rate of request bodies.
//!
//! A timeout that restarts with every frame would accept a body at one byte a second. Here each byte earns time credit,
//! waiting spends it, and the credit never exceeds the grace: a fast start does not allow a long stall later. Only time
//! spent waiting for the client counts, so a slow disk of the server never ends an upload.
//!
//! An answer sent before the end of the body carries `Connection: close`. Otherwise the client would send its next
//! request on a connection that is about to close. HTTP/2 ends only the stream, and has no such header.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderValue, Version, header};
use axum::middleware::Next;
use axum::response::Response;
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use tokio::time::{Instant, Sleep};

use super::settings::HttpSettings;

/// Middleware: enforces the minimum rate on every body, and sets `Connection: close` if the answer leaves it unread.
pub async fn keep_pace(State(pace): State<Pace>, request: Request, next: Next) -> Response {
    let closes_connection = request.version() < Version::HTTP_2;
    let mut read = Arc::default();
    let request = request.map(|body| {
        let paced = PacedBody::new(body, pace);
        read = paced.read.clone();
        Body::new(paced)
    });
    let mut response = next.run(request).await;
    if closes_connection && !read.load(Ordering::Relaxed) {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

/// Minimum rate of a body.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Bytes per second.
    pub rate: u64,
    /// Longest stall of a client that was fast enough so far.
    pub grace: Duration,
}

impl From<&HttpSettings> for Pace {
    fn from(settings: &HttpSettings) -> Self {
        Self { rate: settings.min_body_rate.max(1), grace: settings.body_grace() }
    }
}

/// The body arrived more slowly than the minimum rate, in bytes per second.
#[derive(Debug, thiserror::Error)]
#[error("The body arrived more slowly than {0} bytes per second")]
pub struct TooSlow(pub u64);

/// The time for which a client may still stall: waiting spends it, bytes earn it, the grace caps it.
#[derive(Debug)]
struct Credit {
    pace: Pace,
    left: Duration,
}

impl Credit {
    fn new(pace: Pace) -> Self {
        Self { pace, left: pace.grace }
    }

    fn spend(&mut self, waited: Duration) {
        self.left = self.left.saturating_sub(waited);
    }

    fn earn(&mut self, bytes: usize) {
        let earned = Duration::from_secs_f64(bytes as f64 / self.pace.rate as f64);
        self.left = self.left.saturating_add(earned).min(self.pace.grace);
    }
}

/// A body that ends with [`TooSlow`] when the client has used up its credit.
pub struct PacedBody<B> {
    body: B,
    credit: Credit,
    /// While waiting for the client: the start of the wait, and the timer for the end of the credit.
    waiting: Option<(Instant, Pin<Box<Sleep>>)>,
    /// Whether the body was read to its end.
    read: Arc<AtomicBool>,
}

impl<B: HttpBody> PacedBody<B> {
    /// Enforces `pace` on `body`.
    pub fn new(body: B, pace: Pace) -> Self {
        let read = Arc::new(AtomicBool::new(body.is_end_stream()));
        Self { body, credit: Credit::new(pace), waiting: None, read }
    }

    fn received(&mut self, bytes: usize) {
        if let Some((since, _)) = self.waiting.take() {
            self.credit.spend(since.elapsed());
        }
        self.credit.earn(bytes);
    }
}

impl<B> HttpBody for PacedBody<B>
where
    B: HttpBody<Data = Bytes, Error = axum::Error> + Unpin,
{
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let this = &mut *self;
        if let Poll::Ready(frame) = Pin::new(&mut this.body).poll_frame(cx) {
            this.received(bytes_in(&frame));
            this.read.fetch_or(frame.is_none() || this.body.is_end_stream(), Ordering::Relaxed);
            return Poll::Ready(frame);
        }
        let left = this.credit.left;
        let (_, alarm) = this.waiting.get_or_insert_with(|| (Instant::now(), Box::pin(tokio::time::sleep(left))));
        match alarm.as_mut().poll(cx) {
            Poll::Pending => Poll::Pending,
            Poll::Ready(()) => Poll::Ready(Some(Err(axum::Error::new(TooSlow(this.credit.pace.rate))))),
        }
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

fn bytes_in(frame: &Option<Result<Frame<Bytes>, axum::Error>>) -> usize {
    match frame {
        Some(Ok(frame)) => frame.data_ref().map_or(0, Bytes::len),
        Some(Err(_)) | None => 0,
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use http_body_util::BodyExt;

    use super::*;

    const SECOND: Duration = Duration::from_secs(1);
    const PACE: Pace = Pace { rate: 1000, grace: Duration::from_secs(10) };

    #[test]
    fn a_byte_a_second_uses_the_grace_up() {
        let mut credit = Credit::new(PACE);
        for _ in 0..11 {
            credit.spend(SECOND);
            credit.earn(1);
        }
        assert!(credit.left < SECOND / 2, "{credit:?}");
    }

    #[test]
    fn the_minimum_rate_itself_is_enough_for_ever() {
        let mut credit = Credit::new(PACE);
        for _ in 0..100_000 {
            credit.spend(SECOND);
            credit.earn(1000);
        }
        assert_eq!(credit.left, PACE.grace);
    }

    #[test]
    fn a_fast_start_buys_no_longer_stall() {
        let mut credit = Credit::new(PACE);
        credit.earn(1_000_000_000);
        assert_eq!(credit.left, PACE.grace);
    }

    #[tokio::test]
    async fn a_body_that_never_comes_is_ended_and_says_why() {
        let silent = Body::from_stream(futures_util::stream::pending::<io::Result<Bytes>>());
        let pace = Pace { rate: 1000, grace: Duration::from_millis(1) };
        let error = PacedBody::new(silent, pace).collect().await.unwrap_err();
        assert!(std::error::Error::source(&error).is_some_and(|cause| cause.is::<TooSlow>()), "{error:?}");
    }
}
