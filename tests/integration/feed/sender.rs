//! A sender of frames that does as it is told, mistakes included.

use std::io::Cursor;

use futures_util::{SinkExt, StreamExt};
use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage};
use reqwest::header::HeaderMap;
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_with_config};
use trocar::domain::feed::record::{Body, GapReason, Record};

use crate::support::{Client, Service, soon};

/// Ticks between two frames, of 90,000 a second.
pub const FRAME_TICKS: i64 = 3600;
/// Width and height of the frames, pixels.
pub const SIZE: (u32, u32) = (64, 48);

/// What the server said last.
#[derive(Debug, PartialEq)]
pub enum Heard {
    Word(Value),
    Closed(u16, String),
    Cut,
}

/// One connection.
pub struct Sender {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    pub epoch: u32,
}

/// Opens the connection, or tells the status of the refusal.
pub async fn open(service: &Service, headers: &HeaderMap, in_box: &str) -> Result<Sender, u16> {
    open_at(&service.address().to_string(), headers, in_box).await
}

/// The same at this host and port.
pub async fn open_at(host: &str, headers: &HeaderMap, in_box: &str) -> Result<Sender, u16> {
    let address = format!("ws://{host}/api/v1/boxes/{in_box}/feed");
    let mut request = address.into_client_request().unwrap();
    request.headers_mut().extend(headers.clone());
    match soon("the connection", connect_async_with_config(request, Some(short_words()), false)).await {
        Ok((socket, _)) => Ok(Sender { socket, epoch: 0 }),
        Err(Error::Http(answer)) => Err(answer.status().as_u16()),
        Err(error) => panic!("{error}"),
    }
}

/// What is heard is short: each read clears the whole buffer first.
pub fn short_words() -> WebSocketConfig {
    WebSocketConfig::default().read_buffer_size(4096)
}

/// A hello for the box of the small centre.
pub fn hello(recording: &str) -> Value {
    json!({
        "type": "hello", "protocol": 1, "recording": recording, "trainee": "ada", "task": "peg", "codec": "jpeg",
        "width": SIZE.0, "height": SIZE.1, "time_base": [1, 90_000], "began_at": "2026-11-21T20:14:00Z",
    })
}

/// A connection that has said hello and was welcomed; and what is durable.
pub async fn begin(service: &Service, client: &Client, recording: &str) -> (Sender, Value) {
    let mut sender = open(service, client.headers(), "box-1").await.unwrap();
    sender.say(&hello(recording)).await;
    let Heard::Word(welcome) = sender.hear().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    (sender, welcome)
}

/// A JPEG that is not like that of another number.
pub fn jpeg(number: u64) -> Vec<u8> {
    let shade = (number * 37 % 256) as u8;
    let picture = RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([shade, 255 - shade, 90]));
    let mut bytes = Cursor::new(Vec::new());
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, 80)).unwrap();
    bytes.into_inner()
}

impl Sender {
    pub async fn say(&mut self, word: &Value) {
        self.send(Message::text(word.to_string())).await;
    }

    /// Sends frames of these numbers.
    pub async fn frames(&mut self, numbers: impl IntoIterator<Item = u64>) {
        for number in numbers {
            self.frame(self.epoch, number, number as i64 * FRAME_TICKS).await;
        }
    }

    pub async fn frame(&mut self, epoch: u32, number: u64, time: i64) {
        let payload = jpeg(number);
        self.record(Record { epoch, number, body: Body::Frame { time, is_key: true, payload: &payload } }).await;
    }

    pub async fn gap(&mut self, number: u64, last: u64) {
        let body = Body::Gap { last, reason: GapReason::Camera };
        self.record(Record { epoch: self.epoch, number, body }).await;
    }

    pub async fn record(&mut self, record: Record<'_>) {
        let mut bytes = Vec::new();
        record.write(&mut bytes);
        self.bytes(bytes).await;
    }

    pub async fn bytes(&mut self, bytes: Vec<u8>) {
        self.send(Message::binary(bytes)).await;
    }

    /// Where the server has closed already, what is sent is lost: the reason is heard next.
    async fn send(&mut self, message: Message) {
        let _ = soon("sending", self.socket.send(message)).await;
    }

    pub async fn hear(&mut self) -> Heard {
        loop {
            match soon("a word", self.socket.next()).await {
                Some(Ok(Message::Text(text))) => return Heard::Word(serde_json::from_str(&text).unwrap()),
                Some(Ok(Message::Close(Some(frame)))) => {
                    return Heard::Closed(frame.code.into(), frame.reason.to_string());
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => return Heard::Cut,
            }
        }
    }

    /// Waits until exactly these ranges are acknowledged.
    pub async fn acknowledged(&mut self, ranges: Value) {
        loop {
            match self.hear().await {
                Heard::Word(word) if word["type"] == "ack" => {
                    if word["durable"] == ranges {
                        return;
                    }
                }
                other => panic!("{other:?} before {ranges} was acknowledged"),
            }
        }
    }

    /// The next word that is no acknowledgement.
    pub async fn answer(&mut self) -> Heard {
        loop {
            match self.hear().await {
                Heard::Word(word) if word["type"] == "ack" => {}
                other => return other,
            }
        }
    }

    /// The code with which the server closes next.
    pub async fn closed(&mut self) -> u16 {
        match self.answer().await {
            Heard::Closed(code, why) => {
                assert!(!why.is_empty(), "{code} says why");
                code
            }
            other => panic!("{other:?} where a close was expected"),
        }
    }

    /// Ends the recording and returns its session.
    pub async fn end(&mut self, frames: u64) -> String {
        self.say(&json!({"type": "end", "frames": frames})).await;
        let Heard::Word(ended) = self.answer().await else { panic!("no end") };
        assert_eq!(ended["type"], "ended", "{ended}");
        assert_eq!(self.closed().await, 1000);
        ended["session"].as_str().unwrap().to_owned()
    }
}
