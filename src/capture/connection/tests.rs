use tokio::net::TcpListener;
use tokio_tungstenite::accept_async;

use super::*;
use crate::capture::spool::testing::{add, spool};

const PATIENCE: Duration = Duration::from_millis(500);

/// The agent's next message except pings; `None` if it sends nothing for a while.
async fn next(socket: &mut WebSocketStream<TcpStream>) -> Option<Message> {
    loop {
        match timeout(PATIENCE, socket.next()).await {
            Ok(Some(Ok(Message::Ping(_) | Message::Pong(_)))) => {}
            Ok(message) => return message.map(Result::unwrap),
            Err(_) => return None,
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_end_is_sent_after_everything_is_acknowledged() {
    const FRAMES: u64 = 5;
    let (folder, mut spool, id) = spool(1 << 20);
    add(&mut spool, 0..FRAMES);
    spool.end_live();
    let agent = Agent::new(spool);
    let token = folder.path().join("token");
    std::fs::write(&token, "trc_1").unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let server = Server::new(&format!("http://{}", listener.local_addr().unwrap()), "box-1", &token).unwrap();
    let conversing = tokio::spawn(async move { server.run(&agent, id).await });

    let mut socket = accept_async(listener.accept().await.unwrap().0).await.unwrap();
    let hello = next(&mut socket).await.unwrap();
    assert!(hello.to_text().unwrap().contains("hello"), "{hello}");
    let session = SessionId::at(1_795_000_000_000);
    let welcome = ServerMessage::Welcome { session, epoch: 1, durable: vec![], token_expires_at: None };
    socket.send(word_of(&welcome)).await.unwrap();
    for number in 0..FRAMES {
        let record = next(&mut socket).await.unwrap().into_data();
        assert_eq!(FeedRecord::read(&record).unwrap().number, number);
    }
    assert_eq!(next(&mut socket).await, None, "nothing is acknowledged yet");
    socket.send(word_of(&ServerMessage::Ack { durable: vec![[0, FRAMES - 2]] })).await.unwrap();
    assert_eq!(next(&mut socket).await, None, "the last frame is not acknowledged yet");
    socket.send(word_of(&ServerMessage::Ack { durable: vec![[0, FRAMES - 1]] })).await.unwrap();
    let end = next(&mut socket).await.unwrap();
    assert_eq!(end.to_text().unwrap(), r#"{"type":"end","frames":5}"#);
    socket.send(word_of(&ServerMessage::Ended { session, durable: None })).await.unwrap();
    assert_eq!(conversing.await.unwrap(), DisconnectOutcome::Complete(session));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_one_box_is_not_sent_as_anothers() {
    let (_folder, mut spool, id) = spool(1 << 20);
    add(&mut spool, 0..1);
    let nowhere = Server::new("http://127.0.0.1:1", "box-2", Path::new("no token")).unwrap();
    let parting = nowhere.run(&Agent::new(spool), id).await;
    assert!(matches!(&parting, DisconnectOutcome::Refused(why) if why.contains("--box box-1")), "{parting:?}");
}

fn word_of(word: &ServerMessage) -> Message {
    Message::text(serde_json::to_string(word).unwrap())
}

#[test]
fn every_close_code_is_followed_as_the_document_says() {
    let document = include_str!("../../../docs/feed.md");
    for code in CloseCode::ALL {
        let begins = format!("| {} |", code.number());
        let row = document.lines().find(|line| line.starts_with(&begins)).unwrap();
        let comes_again = row.trim_end_matches(" |").rsplit('|').next().unwrap().trim().starts_with("yes");
        let parting = outcome_of_close_code(code.number(), "why");
        // The agent connects once more if the close code does not name the session.
        let expected = comes_again || code == CloseCode::Done;
        assert_eq!(matches!(parting, DisconnectOutcome::Retry { .. }), expected, "{code:?}: {parting:?}");
    }
    assert!(matches!(outcome_of_close_code(1006, ""), DisconnectOutcome::Retry { .. }));
}

#[test]
fn addresses_lead_to_the_boxs_feed() {
    let address = |server, in_box| Server::new(server, in_box, Path::new("token")).map(|server| server.address);
    let feed = "/api/v1/boxes/box-1";
    assert_eq!(address("http://127.0.0.1:8080", "box-1").unwrap(), format!("ws://127.0.0.1:8080{feed}"));
    assert_eq!(address("https://a.example/trocar/", "box-1").unwrap(), format!("wss://a.example/trocar{feed}"));
    for (server, in_box) in [("a.example", "box-1"), ("ftp://a", "box-1"), ("http://u@a", "b"), ("http://a", "b/../c")]
    {
        assert!(address(server, in_box).is_err(), "{server} {in_box}");
    }
    let is_open = |server| Server::new(server, "b", Path::new("t")).unwrap().is_unencrypted();
    assert_eq!(
        [is_open("http://a.example"), is_open("https://a.example"), is_open("http://[::1]:80")],
        [true, false, false]
    );
}

#[test]
fn a_certificate_that_does_not_hold_yet_names_the_clock() {
    use rustls::CertificateError::{BadSignature, NotValidYet};
    let refused = |why| {
        let inner = std::io::Error::new(std::io::ErrorKind::InvalidData, rustls::Error::InvalidCertificate(why));
        why_not_connected(&Error::Io(inner))
    };
    assert!(refused(NotValidYet).contains("set the clock"), "{}", refused(NotValidYet));
    assert!(!refused(BadSignature).contains("clock"));
    assert!(is_same_reason("not valid at 17:03:12", "not valid at 17:03:14"));
    assert!(!is_same_reason("no answer within 10s", "the connection was cut"));
}
