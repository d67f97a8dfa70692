//! A sender of frames that does what the test asks for, including mistakes.

use std::io::Cursor;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage};
use reqwest::header::HeaderMap;
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio::time::interval;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_with_config};
use trocar::domain::feed::record::{FeedRecord, GapReason, RecordBody};

use super::scene::Frame;
use crate::support::{Client, Service, soon};

/// Ticks between two frames, of 90,000 a second.
pub const FRAME_TICKS: i64 = 3600;
/// Width and height of the frames, pixels.
pub const SIZE: (u32, u32) = (64, 48);

/// A message from the server, or the end of the connection.
#[derive(Debug, PartialEq)]
pub enum Received {
    Json(Value),
    Closed(u16, String),
    Disconnected,
}

/// One connection.
pub struct Sender {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    pub epoch: u32,
}

/// Opens the connection, or returns the status of the refusal.
pub async fn open(service: &Service, headers: &HeaderMap, in_box: &str) -> Result<Sender, u16> {
    let address = service.stranger().request(reqwest::Method::GET, "/").build().unwrap().url().clone();
    open_at(address.as_str().strip_prefix("http://").unwrap().trim_end_matches('/'), headers, in_box).await
}

/// The same at this host, port and path.
pub async fn open_at(host: &str, headers: &HeaderMap, in_box: &str) -> Result<Sender, u16> {
    let address = format!("ws://{host}/api/v1/boxes/{in_box}/feed");
    let mut request = address.into_client_request().unwrap();
    request.headers_mut().extend(headers.clone());
    match soon("the connection", connect_async_with_config(request, Some(short_messages()), false)).await {
        Ok((socket, _)) => Ok(Sender { socket, epoch: 0 }),
        Err(Error::Http(answer)) => Err(answer.status().as_u16()),
        Err(error) => panic!("{error}"),
    }
}

/// A small buffer for short messages: each read clears the whole buffer first.
pub fn short_messages() -> WebSocketConfig {
    WebSocketConfig::default().read_buffer_size(4096)
}

/// A hello message for the box of the small centre.
pub fn hello(recording: &str) -> Value {
    json!({
        "type": "hello", "protocol": 1, "recording": recording, "trainee": "ada", "task": "peg", "codec": "jpeg",
        "width": SIZE.0, "height": SIZE.1, "time_base": [1, 90_000], "began_at": "2026-11-21T20:14:00Z",
    })
}

/// A connection after hello and welcome, and the welcome message.
pub async fn begin(service: &Service, client: &Client, recording: &str) -> (Sender, Value) {
    let mut sender = open(service, client.headers(), "box-1").await.unwrap();
    sender.send_json(&hello(recording)).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    (sender, welcome)
}

/// A JPEG that differs from those of other numbers.
pub fn jpeg(number: u64) -> Vec<u8> {
    let shade = (number * 37 % 256) as u8;
    let picture = RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([shade, 255 - shade, 90]));
    let mut bytes = Cursor::new(Vec::new());
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, 80)).unwrap();
    bytes.into_inner()
}

impl Sender {
    pub async fn send_json(&mut self, message: &Value) {
        self.send_message(Message::text(message.to_string())).await;
    }

    /// Sends frames of these numbers.
    pub async fn send_frames(&mut self, numbers: impl IntoIterator<Item = u64>) {
        for number in numbers {
            self.send_frame(self.epoch, number, number as i64 * FRAME_TICKS).await;
        }
    }

    pub async fn send_frame(&mut self, epoch: u32, number: u64, time: i64) {
        let payload = jpeg(number);
        self.send_record(FeedRecord {
            epoch,
            number,
            body: RecordBody::Frame { time, is_key: true, payload: &payload },
        })
        .await;
    }

    /// Sends these frames again and again, 25 a second, until the future is dropped.
    pub async fn send_in_real_time(&mut self, frames: &[Frame]) {
        let mut ticks = interval(Duration::from_millis(40));
        for number in 0.. {
            ticks.tick().await;
            let frame = &frames[number % frames.len()];
            let body =
                RecordBody::Frame { time: number as i64 * FRAME_TICKS, is_key: frame.is_key, payload: &frame.bytes };
            self.send_record(FeedRecord { epoch: self.epoch, number: number as u64, body }).await;
        }
    }

    pub async fn send_gap(&mut self, number: u64, last: u64) {
        let body = RecordBody::Gap { last, reason: GapReason::Camera };
        self.send_record(FeedRecord { epoch: self.epoch, number, body }).await;
    }

    pub async fn send_record(&mut self, record: FeedRecord<'_>) {
        let mut bytes = Vec::new();
        record.write(&mut bytes);
        self.send_bytes(bytes).await;
    }

    pub async fn send_bytes(&mut self, bytes: Vec<u8>) {
        self.send_message(Message::binary(bytes)).await;
    }

    /// If the server has closed already, the message is lost, and the next receive gives the reason.
    async fn send_message(&mut self, message: Message) {
        let _ = soon("sending", self.socket.send(message)).await;
    }

    pub async fn receive(&mut self) -> Received {
        loop {
            match soon("a message", self.socket.next()).await {
                Some(Ok(Message::Text(text))) => return Received::Json(serde_json::from_str(&text).unwrap()),
                Some(Ok(Message::Close(Some(frame)))) => {
                    return Received::Closed(frame.code.into(), frame.reason.to_string());
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => return Received::Disconnected,
            }
        }
    }

    /// Waits until exactly these ranges are acknowledged.
    pub async fn wait_for_ack(&mut self, ranges: Value) {
        loop {
            match self.receive().await {
                Received::Json(message) if message["type"] == "ack" => {
                    if message["durable"] == ranges {
                        return;
                    }
                }
                other => panic!("{other:?} before {ranges} was acknowledged"),
            }
        }
    }

    /// The next message that is no acknowledgement.
    pub async fn next_answer(&mut self) -> Received {
        loop {
            match self.receive().await {
                Received::Json(message) if message["type"] == "ack" => {}
                other => return other,
            }
        }
    }

    /// The code of the server's close, which must come next.
    pub async fn close_code(&mut self) -> u16 {
        match self.next_answer().await {
            Received::Closed(code, reason) => {
                assert!(!reason.is_empty(), "the close with {code} gives a reason");
                code
            }
            other => panic!("{other:?} where a close was expected"),
        }
    }

    /// Ends the recording and returns its session.
    pub async fn end(&mut self, frames: u64) -> String {
        self.send_json(&json!({"type": "end", "frames": frames})).await;
        let Received::Json(ended) = self.next_answer().await else { panic!("no end") };
        assert_eq!(ended["type"], "ended", "{ended}");
        assert_eq!(self.close_code().await, 1000);
        ended["session"].as_str().unwrap().to_owned()
    }
}
