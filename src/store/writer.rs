//! The writer thread, which owns the only connection that writes.
//!
//! Requests wait in a bounded channel. The writer takes all that wait (up to a limit), runs each in a savepoint of one
//! `BEGIN IMMEDIATE` transaction, commits once, and only then replies to all of them: one fsync serves many requests,
//! and every reply is durable. A request that fails is rolled back alone. If the commit fails, all requests of the
//! batch fail.
//!
//! It is a thread and not a task, because the requests are async closures whose futures are not `Send`, and because a
//! busy runtime must not keep a transaction open.

use std::pin::Pin;

use sqlx::sqlite::SqliteConnection;
use sqlx::{Connection, Executor};
use tokio::sync::{mpsc, oneshot};

use super::error::{StoreError, StoreResult};
use crate::shutdown;

/// Sends requests to the writer thread.
#[derive(Debug)]
pub(super) struct Writer {
    messages: mpsc::Sender<WriterMessage>,
}

/// A message to the writer thread.
enum WriterMessage {
    /// Run a request in a transaction.
    Request(Box<dyn WriteRequest>),
    /// Move the write-ahead log into the database file and empty it.
    EmptyLog(oneshot::Sender<StoreResult<bool>>),
    /// Finish the earlier messages, close the database and end the thread.
    Close(oneshot::Sender<()>),
}

impl Writer {
    /// Starts the thread, which ends when the last sender is dropped. At most `waiting` requests queue up; at most
    /// `batch` of them share a commit.
    pub fn start(connection: SqliteConnection, waiting: usize, batch: usize) -> std::io::Result<Self> {
        let (messages, inbox) = mpsc::channel(waiting.max(1));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
        std::thread::Builder::new()
            .name("store-writer".to_owned())
            .spawn(move || runtime.block_on(run_writer(connection, inbox, batch.max(1))))?;
        Ok(Self { messages })
    }

    /// Runs `work` in a transaction and returns once it is durable. Waits while the queue is full.
    pub async fn run<T, F>(&self, work: F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        let (reply, answer) = oneshot::channel();
        self.send(WriterMessage::Request(Box::new(TypedWriteRequest { work, reply }))).await?;
        answer.await.map_err(|_| StoreError::Closed)?
    }

    /// Empties the write-ahead log; `false` if a reader prevents it.
    pub async fn empty_log(&self) -> StoreResult<bool> {
        let (reply, answer) = oneshot::channel();
        self.send(WriterMessage::EmptyLog(reply)).await?;
        answer.await.map_err(|_| StoreError::Closed)?
    }

    /// Ends the thread after the earlier requests are done and the database is closed.
    pub async fn close(&self) {
        let (reply, answer) = oneshot::channel();
        if self.send(WriterMessage::Close(reply)).await.is_ok() {
            drop(answer.await); // an error means that the thread has ended already
        }
    }

    async fn send(&self, message: WriterMessage) -> StoreResult<()> {
        self.messages.send(message).await.map_err(|_| StoreError::Closed)
    }
}

/// One request of any result type.
trait WriteRequest: Send {
    /// Runs the request in the open savepoint.
    fn run<'c>(self: Box<Self>, tx: &'c mut SqliteConnection) -> Pin<Box<dyn Future<Output = PendingReply> + 'c>>;

    /// Does nothing, because the transaction has failed already.
    fn skip(self: Box<Self>) -> PendingReply;
}

/// A finished request whose reply waits for the commit.
struct PendingReply {
    failure: Option<StoreError>,
    /// Sends the reply. Called once, with the result of the commit.
    send: Box<dyn FnOnce(StoreResult<()>)>,
}

struct TypedWriteRequest<F, T> {
    work: F,
    reply: oneshot::Sender<StoreResult<T>>,
}

impl<F, T> WriteRequest for TypedWriteRequest<F, T>
where
    F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
    T: Send + 'static,
{
    fn run<'c>(self: Box<Self>, tx: &'c mut SqliteConnection) -> Pin<Box<dyn Future<Output = PendingReply> + 'c>> {
        Box::pin(async move {
            let TypedWriteRequest { work, reply } = *self;
            let result = work(tx).await;
            let failure = result.as_ref().err().cloned();
            // The caller may have gone away; then the reply is dropped.
            let send = move |committed: StoreResult<()>| drop(reply.send(committed.and(result)));
            PendingReply { failure, send: Box::new(send) }
        })
    }

    fn skip(self: Box<Self>) -> PendingReply {
        let send = move |lost: StoreResult<()>| drop(self.reply.send(lost.and(Err(StoreError::Closed))));
        PendingReply { failure: None, send: Box::new(send) }
    }
}

async fn run_writer(mut connection: SqliteConnection, mut inbox: mpsc::Receiver<WriterMessage>, batch: usize) {
    let _guard = AbortOnPanic;
    let mut messages = Vec::with_capacity(batch);
    let mut closers = Vec::new();
    while closers.is_empty() && inbox.recv_many(&mut messages, batch).await > 0 {
        let mut requests = Vec::with_capacity(messages.len());
        let mut emptiers = Vec::new();
        for message in messages.drain(..) {
            match message {
                WriterMessage::Request(request) => requests.push(request),
                WriterMessage::EmptyLog(reply) => emptiers.push(reply),
                WriterMessage::Close(reply) => closers.push(reply),
            }
        }
        if !requests.is_empty() {
            commit_batch(&mut connection, requests).await;
        }
        for reply in emptiers {
            drop(reply.send(empty_log(&mut connection).await)); // the caller may have gone away
        }
    }
    if let Err(error) = connection.close().await {
        tracing::warn!(%error, "could not close the database cleanly; the next start recovers it");
    }
    for reply in closers {
        let _ = reply.send(()); // the caller may have gone away
    }
}

/// Runs a batch, commits it and sends the replies.
async fn commit_batch(connection: &mut SqliteConnection, requests: Vec<Box<dyn WriteRequest>>) {
    let mut answers = Vec::with_capacity(requests.len());
    let outcome = run_batch(connection, requests, &mut answers).await;
    if let Err(failure) = &outcome {
        roll_back(connection, failure).await;
    }
    for answer in answers {
        (answer.send)(outcome.clone());
    }
}

const CHECKPOINT: &str = "PRAGMA wal_checkpoint(TRUNCATE)";

async fn empty_log(connection: &mut SqliteConnection) -> StoreResult<bool> {
    let busy: i64 = sqlx::query_scalar(CHECKPOINT).fetch_one(connection).await?;
    Ok(busy == 0)
}

/// Runs a batch in one transaction. Every request leaves a pending reply, even if the transaction fails before it runs.
async fn run_batch(
    tx: &mut SqliteConnection,
    batch: Vec<Box<dyn WriteRequest>>,
    answers: &mut Vec<PendingReply>,
) -> StoreResult<()> {
    let mut outcome = tx.execute("BEGIN IMMEDIATE").await.map(drop).map_err(StoreError::from);
    for request in batch {
        match outcome {
            Ok(()) => outcome = run_in_savepoint(tx, request, answers).await,
            Err(_) => answers.push(request.skip()),
        }
    }
    outcome?;
    Ok(tx.execute("COMMIT").await.map(drop)?)
}

/// Runs one request in a savepoint. An error of the savepoint itself is an error of the whole batch: on a full disk,
/// for example, SQLite rolls back the whole transaction.
async fn run_in_savepoint(
    tx: &mut SqliteConnection,
    request: Box<dyn WriteRequest>,
    answers: &mut Vec<PendingReply>,
) -> StoreResult<()> {
    if let Err(error) = tx.execute("SAVEPOINT request").await {
        answers.push(request.skip());
        return Err(error.into());
    }
    let answer = request.run(tx).await;
    let failure = answer.failure.clone();
    answers.push(answer);
    if let Some(failure) = failure {
        let undone = tx.execute("ROLLBACK TO request").await;
        undone.map_err(|_| failure)?; // the savepoint is gone: the request's error broke the whole transaction
    }
    Ok(tx.execute("RELEASE request").await.map(drop)?)
}

async fn roll_back(tx: &mut SqliteConnection, failure: &StoreError) {
    if failure.is_failed_sync() {
        shutdown::abort_process("the database could not be synced to the disk");
    }
    tracing::warn!(%failure, "write transaction failed; rolled back");
    // This fails if SQLite has already rolled back by itself, which has the same effect.
    let _ = tx.execute("ROLLBACK").await;
}

/// Aborts the process if a request panics: the transaction is then open in an unknown state. The next start recovers.
struct AbortOnPanic;

impl Drop for AbortOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            shutdown::abort_process("the store's writer panicked");
        }
    }
}
