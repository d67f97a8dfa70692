//! Clients without an account that open many connections: others are answered, and open streams stay open.

use std::net::SocketAddr;
use std::time::Duration;

use reqwest::StatusCode;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio::task::JoinSet;
use tokio::time::timeout;

use crate::support::{Service, let_time_pass};

/// Connections that the service takes.
const PLACES: usize = 20;
/// Connections that the client without an account holds.
const HELD: usize = 3 * PLACES;
/// Pause until it opens a connection again that the service has closed.
const REFILL_PAUSE: Duration = Duration::from_millis(100);
/// Longest wait of others for an answer.
const MAX_WAIT: Duration = Duration::from_secs(1);
/// A request whose head does not end.
const HALF_A_HEAD: &[u8] = b"GET /x HTTP/1.1\r\nHost: x\r\nX-A: ";
/// A request whose body does not end.
const HALF_A_BODY: &[u8] =
    b"POST /api/v1/sign-in HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: 4000\r\n\r\n{";

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_holds_all_connections_does_not_keep_others_out() {
    for unfinished in [HALF_A_HEAD, HALF_A_BODY] {
        let service = Service::start_with(|settings| settings.http.max_connections = PLACES).await;
        let administrator = service.administrator().await;
        let mut events = administrator.get("/api/v1/events").await;
        assert_eq!(events.status(), StatusCode::OK);
        let mut held = JoinSet::new();
        for _ in 0..HELD {
            held.spawn(hold_a_connection(service.address(), unfinished));
        }
        let_time_pass(3 * REFILL_PAUSE).await;
        for _ in 0..20 {
            let other = service.stranger().with("cookie", &administrator.cookie());
            let answer = timeout(MAX_WAIT, other.get("/api/v1/me")).await.expect("an answer within a second");
            assert_eq!(answer.status(), StatusCode::OK);
        }
        while let Ok(chunk) = timeout(REFILL_PAUSE, events.chunk()).await {
            assert!(matches!(chunk, Ok(Some(_))), "the event stream is closed: {chunk:?}");
        }
        assert_eq!(held.len(), HELD);
        assert!(held.try_join_next().is_none(), "no client has ended");
    }
}

/// Holds a connection with an unfinished request for ever, from an address of its own. It connects again when the
/// service ends the connection.
async fn hold_a_connection(to: SocketAddr, unfinished: &'static [u8]) {
    loop {
        if let Ok(mut wire) = connect(to).await {
            // The service may end the connection at any moment.
            let _ = wire.write_all(unfinished).await;
            let _ = wire.read_to_end(&mut Vec::new()).await;
        }
        let_time_pass(REFILL_PAUSE).await;
    }
}

async fn connect(to: SocketAddr) -> std::io::Result<TcpStream> {
    let socket = TcpSocket::new_v4()?;
    socket.bind(([127, 0, 0, 2], 0).into())?;
    socket.connect(to).await
}
