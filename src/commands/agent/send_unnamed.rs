//! Sends the file of a recording without a name to the server, where it waits until staff say whose it is.

use std::time::Duration;

use hyper::http::{HeaderMap, HeaderValue, StatusCode, header};
use tokio::fs::File;
use tokio::time::timeout;

use crate::capture::standby::unnamed::{FileOutcome, UnnamedFile};
use crate::commands::upload::client::{RequestError, ServiceClient};

/// Longest time for the answer, on top of that for the bytes: the server hashes the file.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(300);
/// Slowest network that is waited for, bytes a second. A connection that was cut without a word ends like this.
const MIN_BYTES_PER_S: u64 = 20_000;

/// Sends a file.
pub(super) async fn send_unnamed(client: &ServiceClient, file: UnnamedFile) -> FileOutcome {
    let UnnamedFile { path, filename, recorded_at, task } = file;
    let opened = async {
        let file = File::open(&path).await?;
        let bytes = file.metadata().await?.len();
        std::io::Result::Ok((file, bytes))
    };
    let (file, bytes) = match opened.await {
        Ok(opened) => opened,
        Err(error) => return FileOutcome::Retry(format!("{} cannot be read: {error}", path.display())),
    };
    let fields = [("filename", Some(filename)), ("recorded_at", recorded_at), ("task", task)];
    let query: Vec<String> =
        fields.into_iter().filter_map(|(name, value)| Some(format!("{name}={}", encoded(&value?)))).collect();
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(bytes));
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    let limit = ANSWER_TIMEOUT + Duration::from_secs(bytes / MIN_BYTES_PER_S);
    let address = format!("/waiting-recordings?{}", query.join("&"));
    match timeout(limit, client.post_file(&address, headers, file, bytes)).await {
        Err(_) => FileOutcome::Retry(format!("the server did not take the recording within {limit:?}")),
        Ok(Ok(_)) => FileOutcome::Received,
        Ok(Err(error)) => outcome_of(error),
    }
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
        _ if error.is_passing() => FileOutcome::Retry(error.to_string()),
        _ => FileOutcome::Refused(error.to_string()),
    }
}

/// A value of a query: all but letters, digits and some marks as `%XX`.
fn encoded(value: &str) -> String {
    let byte = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    value.bytes().map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(status: u16, kind: &str) -> FileOutcome {
        let status = StatusCode::from_u16(status).unwrap();
        let (title, detail) = ("Refused".to_owned(), "why".to_owned());
        outcome_of(RequestError::Refused { status, kind: kind.to_owned(), title, detail, wait: None })
    }

    #[test]
    fn a_recording_that_the_server_has_is_received_and_a_busy_server_is_asked_again() {
        assert_eq!(refused(409, "duplicate-recording"), FileOutcome::Received);
        for (status, kind) in [(503, "busy"), (507, "disk-full"), (500, "")] {
            assert!(matches!(refused(status, kind), FileOutcome::Retry(_)), "{status}");
        }
        for (status, kind) in
            [(409, "conflict"), (429, "limit"), (401, "unauthenticated"), (413, "too-large"), (422, "invalid")]
        {
            assert!(matches!(refused(status, kind), FileOutcome::Refused(_)), "{status}");
        }
        let cut = outcome_of(RequestError::Connection("cut".to_owned()));
        assert_eq!(cut, FileOutcome::Retry("cut".to_owned()));
    }

    #[test]
    fn values_of_a_query_are_encoded() {
        assert_eq!(encoded("box-1 2026-11-30T14:05Z&a=b"), "box-1%202026-11-30T14%3A05Z%26a%3Db");
    }
}
