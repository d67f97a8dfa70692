//! Sends the file of a recording without a name to the server, where it waits until staff say whose it is.

use std::time::Duration;

use hyper::http::{HeaderMap, HeaderValue, StatusCode, header};

use crate::capture::standby::unnamed::{FileOutcome, UnnamedFile};
use crate::commands::upload::client::{FileLimits, RequestError, ServiceClient};
use crate::http::file::percent_encoded;

/// A minute without a byte is a connection that was cut; the server hashes the file before it answers.
const LIMITS: FileLimits = FileLimits { stall: Duration::from_secs(60), answer: Duration::from_secs(300) };

/// Sends a file. If the server does not know its task any more, it is sent without.
pub(super) async fn send_unnamed(client: &ServiceClient, file: UnnamedFile) -> FileOutcome {
    send_within(LIMITS, client, file).await
}

async fn send_within(limits: FileLimits, client: &ServiceClient, file: UnnamedFile) -> FileOutcome {
    match send(limits, client, &file).await {
        Err(RequestError::Refused { kind, .. }) if kind == "unknown-reference" && file.task.is_some() => {
            tracing::warn!(task = file.task, "the server has no such task any more; the recording is sent without it");
            outcome(send(limits, client, &UnnamedFile { task: None, ..file }).await)
        }
        attempt => outcome(attempt),
    }
}

async fn send(limits: FileLimits, client: &ServiceClient, of: &UnnamedFile) -> Result<(), RequestError> {
    let fields =
        [("filename", Some(&of.filename)), ("recorded_at", of.recorded_at.as_ref()), ("task", of.task.as_ref())];
    let field = |(name, value): (&str, Option<&String>)| Some(format!("{name}={}", percent_encoded(value?)));
    let query: Vec<String> = fields.into_iter().filter_map(field).collect();
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(of.bytes));
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    let address = format!("/waiting-recordings?{}", query.join("&"));
    client.post_file(&address, headers, ((of.open)(), of.bytes), limits).await.map(drop)
}

fn outcome(attempt: Result<(), RequestError>) -> FileOutcome {
    attempt.map_or_else(outcome_of, |()| FileOutcome::Received)
}

/// What to do after this error.
fn outcome_of(error: RequestError) -> FileOutcome {
    match &error {
        // An answer of an earlier attempt was lost: the server has the recording.
        RequestError::Refused { kind, .. } if kind == "duplicate-recording" => FileOutcome::Received,
        // Such a limit may last a day: other recordings are sent meanwhile.
        RequestError::Refused { status: StatusCode::CONFLICT | StatusCode::TOO_MANY_REQUESTS, .. } => {
            FileOutcome::Refused(error.to_string())
        }
        RequestError::Refused { status: StatusCode::UNAUTHORIZED, .. } => FileOutcome::Refused(format!(
            "{error}. Make a new token for the box's agent on the page People and put it into the token file"
        )),
        RequestError::Connection(_) | RequestError::Refused { status: StatusCode::SERVICE_UNAVAILABLE, .. } => {
            FileOutcome::Retry(error.to_string())
        }
        _ if error.is_passing() => FileOutcome::Failed(error.to_string()),
        _ => FileOutcome::Refused(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpListener;

    use std::sync::Arc;

    use super::*;
    use crate::capture::standby::unnamed::OpenFile;
    use crate::ids::FeedId;

    fn refused(status: u16, kind: &str) -> FileOutcome {
        let status = StatusCode::from_u16(status).unwrap();
        let (title, detail) = ("Refused".to_owned(), "why".to_owned());
        outcome_of(RequestError::Refused { status, kind: kind.to_owned(), title, detail, wait: None })
    }

    #[test]
    fn a_recording_that_the_server_has_is_received_and_a_busy_server_is_asked_again() {
        assert_eq!(refused(409, "duplicate-recording"), FileOutcome::Received);
        assert!(matches!(refused(503, "busy"), FileOutcome::Retry(_)));
        for (status, kind) in [(507, "disk-full"), (500, "")] {
            assert!(matches!(refused(status, kind), FileOutcome::Failed(_)), "{status}");
        }
        for (status, kind) in
            [(409, "conflict"), (429, "limit"), (401, "unauthenticated"), (413, "too-large"), (422, "invalid")]
        {
            assert!(matches!(refused(status, kind), FileOutcome::Refused(_)), "{status}");
        }
        let cut = outcome_of(RequestError::Connection("cut".to_owned()));
        assert_eq!(cut, FileOutcome::Retry("cut".to_owned()));
    }

    /// A client of this listener, and a recording of this many bytes without a name.
    fn client_of(listener: &TcpListener, bytes: u64) -> (ServiceClient, UnnamedFile) {
        let open: OpenFile = Arc::new(|| Box::pin(tokio::io::repeat(0)));
        let filename = "box-1 2026-11-30T14-05.mp4".to_owned();
        let client = ServiceClient::anonymous(&format!("http://{}", listener.local_addr().unwrap())).unwrap();
        let task = Some("t&1".to_owned());
        (client, UnnamedFile { recording: FeedId::at(1), bytes, open, filename, recorded_at: None, task })
    }

    #[tokio::test]
    async fn a_connection_that_takes_nothing_any_more_is_given_up() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (client, file) = client_of(&listener, 256 << 20); // more than the kernel buffers
        let accepted = tokio::spawn(async move { listener.accept().await.unwrap() }); // open, and never read
        let limits = FileLimits { stall: Duration::from_millis(300), answer: Duration::from_secs(60) };
        let FileOutcome::Retry(why) = send_within(limits, &client, file).await else { panic!("not given up") };
        assert_eq!(why, "the network took nothing for 300ms");
        drop(accepted.await);
    }

    #[tokio::test]
    async fn a_recording_whose_task_was_deleted_is_sent_without_it() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (client, file) = client_of(&listener, 10);
        let served = tokio::spawn(async move {
            let mut requests = Vec::new();
            for (status, body) in
                [("422 Unprocessable Content", r#"{"type": "x/unknown-reference"}"#), ("201 Created", "{}")]
            {
                let (mut stream, _) = listener.accept().await.unwrap();
                let mut request = Vec::new();
                while !request.ends_with(&[0; 10]) {
                    assert!(stream.read_buf(&mut request).await.unwrap() > 0);
                }
                requests.push(String::from_utf8_lossy(&request).lines().next().unwrap().to_owned());
                let answer = format!("HTTP/1.1 {status}\r\ncontent-length: {}\r\n\r\n{body}", body.len());
                stream.write_all(answer.as_bytes()).await.unwrap();
            }
            requests
        });
        assert_eq!(send_unnamed(&client, file).await, FileOutcome::Received);
        let address = "POST /api/v1/waiting-recordings?filename=box-1%202026-11-30T14-05.mp4";
        let requests = served.await.unwrap();
        assert_eq!(requests, [format!("{address}&task=t%261 HTTP/1.1"), format!("{address} HTTP/1.1")]);
    }
}
