//! Limits the answers that read or write much: paths, diagnostics, tables of features. Each is made piece by piece, so
//! that it needs little memory at any length, and sent at the client's pace.
//!
//! A heavy answer occupies a slot from its beginning until its last piece is sent. One caller has few slots, so that no
//! caller can occupy all of them. A request waits for a slot for a limited time. A slot is freed when the client
//! disconnects, and when it takes no piece for as long as a connection may stall. Pieces are made on blocking threads,
//! at most as many at a time as half the cores.

use std::collections::HashMap;
use std::fmt::Display;
use std::io;
use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::body::{Body, HttpBody};
use axum::http::header;
use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use hyper::body::{Frame, SizeHint};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};

use super::compress::MAX_COMPRESSED_BYTES;
use super::error::{HandlerResult, ProblemResponse, Refusal, busy};
use super::settings::HttpSettings;
use crate::domain::scope::{Actor, Scope};

/// An answer of at most this size is complete before it is sent, bytes: it states its length, can be compressed, and a
/// failure is still a problem document.
const MAX_WHOLE_BYTES: usize = MAX_COMPRESSED_BYTES as usize;

/// Largest part that is passed to the connection at once, bytes.
const MAX_PART_BYTES: usize = 64 * 1024;

/// Seconds after which a refused client should try again.
const RETRY_AFTER_S: u32 = 5;

/// Makes an answer's pieces one after the other, on a blocking thread.
pub type Pieces = Box<dyn Iterator<Item = io::Result<Vec<u8>>> + Send>;

/// The slots for heavy answers; clones share them.
#[derive(Clone, Debug)]
pub struct HeavyAnswers(Arc<HeavyAnswerSlots>);

#[derive(Debug)]
struct HeavyAnswerSlots {
    of_all: Arc<Semaphore>,
    max_of_one: usize,
    of_callers: Mutex<HashMap<Actor, CallerSlots>>,
    /// Threads that may make pieces at the same time.
    threads: Arc<Semaphore>,
    /// Longest wait for a slot.
    max_wait: Duration,
    /// Longest time until a client takes the next part.
    max_stall: Duration,
}

/// The slots of one caller.
#[derive(Debug)]
struct CallerSlots {
    slots: Arc<Semaphore>,
    /// Requests that hold a slot or wait for one. The entry is removed with the last of them.
    requests: usize,
}

/// An occupied slot, freed when its last clone is dropped.
#[derive(Clone, Debug)]
pub struct HeavySlot(Arc<OccupiedSlot>);

#[derive(Debug)]
struct OccupiedSlot {
    _of_all: OwnedSemaphorePermit,
    _of_caller: OwnedSemaphorePermit,
    request: CallerRequest,
}

/// A request that is counted in its caller's [`CallerSlots`].
#[derive(Debug)]
struct CallerRequest {
    slots: Arc<HeavyAnswerSlots>,
    caller: Actor,
}

impl HeavyAnswers {
    /// The slots that these settings allow.
    pub fn new(settings: &HttpSettings) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self(Arc::new(HeavyAnswerSlots {
            of_all: Arc::new(Semaphore::new(settings.max_heavy_answers)),
            max_of_one: settings.max_heavy_answers_of_one,
            of_callers: Mutex::default(),
            threads: Arc::new(Semaphore::new((cores / 2).max(1))),
            max_wait: settings.heavy_answer_wait(),
            max_stall: settings.write_timeout(),
        }))
    }

    /// Waits for a slot: first for one of the caller's, then for one of all.
    ///
    /// # Errors
    /// The wait takes too long: 429 if the caller occupies all of their slots, else 503.
    pub async fn take(&self, scope: &Scope) -> HandlerResult<HeavySlot> {
        let slots = &self.0;
        let (request, of_caller) = slots.count_request(scope.actor());
        let deadline = tokio::time::Instant::now() + slots.max_wait;
        let of_caller = tokio::time::timeout_at(deadline, of_caller.acquire_owned()).await;
        let of_caller = of_caller.map_err(|_| too_many_of_caller(slots.max_of_one))?;
        let of_all = tokio::time::timeout_at(deadline, slots.of_all.clone().acquire_owned()).await;
        let of_all = of_all.map_err(|_| too_many_of_all())?;
        let [of_caller, of_all] =
            [of_caller, of_all].map(|permit| permit.map_err(|cause| ProblemResponse::internal("taking a slot", cause)));
        Ok(HeavySlot(Arc::new(OccupiedSlot { _of_all: of_all?, _of_caller: of_caller?, request })))
    }
}

impl HeavyAnswerSlots {
    fn count_request(self: &Arc<Self>, caller: Actor) -> (CallerRequest, Arc<Semaphore>) {
        let mut of_callers = self.lock();
        let new = || CallerSlots { slots: Arc::new(Semaphore::new(self.max_of_one)), requests: 0 };
        let of_caller = of_callers.entry(caller).or_insert_with(new);
        of_caller.requests += 1;
        (CallerRequest { slots: self.clone(), caller }, of_caller.slots.clone())
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Actor, CallerSlots>> {
        self.of_callers.lock().unwrap_or_else(PoisonError::into_inner) // counts are whole at every moment
    }
}

impl Drop for CallerRequest {
    fn drop(&mut self) {
        let mut of_callers = self.slots.lock();
        if let Some(of_caller) = of_callers.get_mut(&self.caller) {
            of_caller.requests -= 1;
            if of_caller.requests == 0 {
                of_callers.remove(&self.caller);
            }
        }
    }
}

fn too_many_of_caller(most: usize) -> ProblemResponse {
    Refusal::TooMany
        .with(format!(
            "Your account already has {most} large answers in progress. Wait until one of them has arrived, or cancel \
             it, and try again."
        ))
        .member("limit", most)
        .header(header::RETRY_AFTER, RETRY_AFTER_S)
}

fn too_many_of_all() -> ProblemResponse {
    busy("The service is sending many large answers at the moment. Try again in a few seconds.")
}

impl HeavySlot {
    /// Runs work on a blocking thread. The slot stays occupied until the work ends, even if the caller is gone.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> HandlerResult<T> {
        let slot = self.clone();
        let thread = self.thread().await?;
        let done = tokio::task::spawn_blocking(move || {
            let done = work();
            drop((thread, slot));
            done
        });
        done.await.map_err(|cause| ProblemResponse::internal("making a large answer", cause))
    }

    /// Runs asynchronous work that reads much, such as the indexing of a file. The slot stays occupied until the work
    /// ends, even if the caller is gone.
    pub async fn complete<T: Send + 'static>(
        &self,
        work: impl Future<Output = T> + Send + 'static,
    ) -> HandlerResult<T> {
        let slot = self.clone();
        let thread = self.thread().await?;
        let done = tokio::spawn(async move {
            let done = work.await;
            drop((thread, slot));
            done
        });
        done.await.map_err(|cause| ProblemResponse::internal("reading for a large answer", cause))
    }

    /// The right to use a blocking thread.
    async fn thread(&self) -> HandlerResult<OwnedSemaphorePermit> {
        let thread = self.0.request.slots.threads.clone().acquire_owned().await;
        thread.map_err(|cause| ProblemResponse::internal("waiting for a thread", cause))
    }

    /// Makes an answer's body of pieces: whole if it is small, else sent while it is made. `open` runs on a blocking
    /// thread.
    ///
    /// # Errors
    /// `open` fails, or one of the first pieces.
    pub async fn body(self, open: impl FnOnce() -> HandlerResult<Pieces> + Send + 'static) -> HandlerResult<Body> {
        let BegunAnswer { begun, rest } = self.run(move || open().and_then(begin_answer)).await??;
        let length = rest.is_none().then(|| begun.iter().map(|piece| piece.len() as u64).sum());
        let slot = self.clone();
        let rest = futures_util::stream::try_unfold((slot, rest), |(slot, rest)| async move {
            let Some(mut pieces) = rest else { return Ok::<_, PieceError>(None) };
            let made = slot.run(move || (pieces.next(), pieces)).await.map_err(|_| PieceError::Thread)?;
            let (Some(piece), pieces) = made else { return Ok(None) };
            Ok(Some((Bytes::from(piece?), (slot, Some(pieces)))))
        });
        let begun = futures_util::stream::iter(begun.into_iter().map(Ok));
        Ok(self.stream(length, begun.chain(rest)))
    }

    /// A body that is sent while `pieces` makes it; `length` if it is known, bytes. A failure closes the connection
    /// before the answer's end.
    pub fn stream<E: Display + Send + 'static>(
        self,
        length: Option<u64>,
        pieces: impl Stream<Item = Result<Bytes, E>> + Send + 'static,
    ) -> Body {
        let (to, parts) = mpsc::channel(1);
        tokio::spawn(async move {
            let mut pieces = pin!(pieces);
            while let Some(piece) = pieces.next().await {
                match piece {
                    Ok(piece) => {
                        if self.send_piece(piece, &to).await.is_err() {
                            return; // the client is gone or does not read
                        }
                    }
                    Err(error) => {
                        tracing::error!(%error, "large answer failed; connection closed before its end");
                        return;
                    }
                }
            }
            let _ = self.send_part(BodyPart::End, &to).await; // without it the body ends with an error
        });
        Body::new(HeavyBody { parts, left: length, has_ended: false })
    }

    async fn send_piece(&self, mut piece: Bytes, to: &mpsc::Sender<BodyPart>) -> Result<(), ClientGone> {
        while !piece.is_empty() {
            self.send_part(BodyPart::Data(piece.split_to(piece.len().min(MAX_PART_BYTES))), to).await?;
        }
        Ok(())
    }

    async fn send_part(&self, part: BodyPart, to: &mpsc::Sender<BodyPart>) -> Result<(), ClientGone> {
        let sent = tokio::time::timeout(self.0.request.slots.max_stall, to.send(part)).await;
        sent.map_err(|_| ClientGone)?.map_err(|_| ClientGone)
    }
}

/// The first pieces of an answer, and what makes the further ones; `None` if there are none.
struct BegunAnswer {
    begun: Vec<Bytes>,
    rest: Option<Pieces>,
}

fn begin_answer(mut pieces: Pieces) -> HandlerResult<BegunAnswer> {
    let (mut begun, mut bytes) = (Vec::new(), 0);
    while bytes <= MAX_WHOLE_BYTES {
        let Some(piece) = pieces.next() else { return Ok(BegunAnswer { begun, rest: None }) };
        let piece = piece.map_err(|cause| ProblemResponse::internal("making a large answer", cause))?;
        bytes += piece.len();
        begun.push(Bytes::from(piece));
    }
    Ok(BegunAnswer { begun, rest: Some(pieces) })
}

/// The client has disconnected, or takes no part for too long.
struct ClientGone;

/// Why a piece could not be made.
#[derive(Debug, thiserror::Error)]
enum PieceError {
    #[error(transparent)]
    Unreadable(#[from] io::Error),
    #[error("the thread that made it ended")]
    Thread,
}

/// What the task that makes an answer sends to its body.
enum BodyPart {
    Data(Bytes),
    /// The answer is complete.
    End,
}

/// The body of a heavy answer.
struct HeavyBody {
    parts: mpsc::Receiver<BodyPart>,
    /// Bytes to come, if the length is known.
    left: Option<u64>,
    has_ended: bool,
}

impl HttpBody for HeavyBody {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        if self.has_ended {
            return Poll::Ready(None); // a compressor polls again after the end
        }
        Poll::Ready(match ready!(self.parts.poll_recv(cx)) {
            Some(BodyPart::Data(part)) => {
                self.left = self.left.map(|left| left.saturating_sub(part.len() as u64));
                Some(Ok(Frame::data(part)))
            }
            Some(BodyPart::End) => {
                self.has_ended = true;
                None
            }
            None => Some(Err(io::Error::other("the answer ended early"))),
        })
    }

    fn is_end_stream(&self) -> bool {
        self.has_ended || self.left == Some(0)
    }

    fn size_hint(&self) -> SizeHint {
        self.left.map(SizeHint::with_exact).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use futures_util::TryStreamExt;
    use http_body_util::BodyExt;

    use super::*;
    use crate::ids::PersonId;

    fn answers(change: impl FnOnce(&mut HttpSettings)) -> HeavyAnswers {
        let mut settings =
            HttpSettings { max_heavy_answers: 3, max_heavy_answers_of_one: 2, ..HttpSettings::default() };
        change(&mut settings);
        HeavyAnswers::new(&settings)
    }

    fn person(number: i64) -> Scope {
        Scope::instructor(PersonId::at(number))
    }

    fn pieces(
        pieces: impl IntoIterator<Item = io::Result<Vec<u8>>, IntoIter: Send + 'static>,
    ) -> HandlerResult<Pieces> {
        Ok(Box::new(pieces.into_iter()))
    }

    #[tokio::test]
    async fn one_caller_cannot_take_all_slots_and_freed_slots_can_be_taken_again() {
        let answers = answers(|settings| settings.heavy_answer_wait_s = 0.01);
        let (ada, bob, eve) = (person(1), person(2), person(3));
        let hers = [answers.take(&ada).await.unwrap(), answers.take(&ada).await.unwrap()];
        assert_eq!(answers.take(&ada).await.unwrap_err().refusal, Refusal::TooMany);
        let his = answers.take(&bob).await.unwrap();
        assert_eq!(answers.take(&eve).await.unwrap_err().refusal, Refusal::Busy);
        drop(hers);
        assert!(answers.take(&eve).await.is_ok() && answers.take(&ada).await.is_ok());
        drop(his);
        assert!(answers.0.lock().is_empty(), "no caller is remembered");
    }

    #[tokio::test]
    async fn a_request_waits_for_a_slot_and_one_that_gives_up_leaves_none_occupied() {
        let answers = answers(|settings| settings.max_heavy_answers_of_one = 1);
        let ada = person(1);
        let first = answers.take(&ada).await.unwrap();
        let given_up = tokio::time::timeout(Duration::from_millis(5), answers.take(&ada)).await;
        assert!(given_up.is_err(), "it waits");
        let (next, ()) = tokio::join!(answers.take(&ada), async { drop(first) });
        drop(next.unwrap());
        assert!(answers.0.lock().is_empty());
    }

    #[tokio::test]
    async fn a_small_answer_states_its_length_and_a_large_one_is_sent_while_it_is_made() {
        let answers = answers(|_| ());
        let slot = answers.take(&person(1)).await.unwrap();
        let small = slot.body(|| pieces([Ok(vec![1; 70_000]), Ok(vec![2; 5])])).await.unwrap();
        assert_eq!(small.size_hint().exact(), Some(70_005));
        assert_eq!(small.collect().await.unwrap().to_bytes(), [vec![1; 70_000], vec![2; 5]].concat());
        let slot = answers.take(&person(1)).await.unwrap();
        let large = slot.body(|| pieces((0..50).map(|_| Ok(vec![3; 100_000])))).await.unwrap();
        assert_eq!(large.size_hint().exact(), None);
        assert_eq!(large.collect().await.unwrap().to_bytes().len(), 5_000_000);
    }

    #[tokio::test]
    async fn a_body_that_has_ended_ends_again() {
        let answers = answers(|_| ());
        for length in [10, 3 << 20] {
            let slot = answers.take(&person(1)).await.unwrap();
            let mut body = slot.body(move || pieces([Ok(vec![1; length])])).await.unwrap();
            while let Some(frame) = body.frame().await {
                frame.unwrap();
            }
            assert!(body.frame().await.is_none(), "compression asks once more");
        }
    }

    #[tokio::test]
    async fn a_failure_is_a_problem_at_first_and_later_ends_the_body_with_an_error() {
        let answers = answers(|_| ());
        let failure = || Err(io::Error::other("unreadable"));
        let slot = answers.take(&person(1)).await.unwrap();
        let early = slot.body(move || pieces([Ok(vec![1; 9]), failure()])).await;
        assert_eq!(early.unwrap_err().refusal, Refusal::Internal);
        let slot = answers.take(&person(1)).await.unwrap();
        let late = slot.body(move || pieces([Ok(vec![1; 3 << 20]), failure()])).await.unwrap();
        let parts: Result<Vec<Bytes>, _> = late.into_data_stream().try_collect().await;
        assert!(parts.is_err());
    }

    #[tokio::test]
    async fn an_answer_that_is_not_read_or_whose_client_is_gone_frees_its_slot() {
        let answers = answers(|settings| {
            settings.max_heavy_answers_of_one = 1;
            settings.write_timeout_s = 0.02;
        });
        let ada = person(1);
        let endless = || pieces(std::iter::repeat_with(|| Ok(vec![0; 1 << 20])));
        let slot = answers.take(&ada).await.unwrap();
        let unread = slot.body(endless).await.unwrap();
        let slot = answers.take(&ada).await.unwrap(); // after 20 ms
        let parts: Result<Vec<Bytes>, _> = unread.into_data_stream().try_collect().await;
        assert!(parts.is_err(), "its end is no regular end");
        drop(slot.body(endless).await.unwrap());
        answers.take(&ada).await.unwrap();
    }
}
