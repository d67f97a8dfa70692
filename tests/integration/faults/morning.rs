//! The load of a busy morning: the routes that people read stay quick, and the service stays small.
//!
//! A class signs in, 200 browsers show *Live*, 50 recordings are uploaded and a thousand slow or idle clients hold
//! connections, all at once and on the same machine as the service.

use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::StreamExt;
use reqwest::{Client, Method, StatusCode};
use serde_json::{Value, json};
use tokio::task::JoinSet;
use tokio_tungstenite::connect_async_with_config;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

use super::Centre;
use super::centre::json_of;
use super::slow::{Slow, run_slow_client};
use crate::feed::scene::{Folder, Scene};
use crate::feed::sender::{Received, hello, open_at, short_messages};
use crate::support::let_time_pass;

/// People of the class; each has an account and sends recordings.
const PEOPLE: usize = 40;
/// Administrators whose browsers show *Live*: one person may hold 96 streams.
const WATCHING: usize = 5;
/// Browsers that show *Live*: each has an event stream and watches the recording that arrives, with its pictures.
const BROWSERS: usize = 200;
/// Uploads at the same time.
const UPLOADS: usize = 50;
/// A piece of an upload and the time between two pieces: 4 Mbit/s, the recording of a box in real time.
const PIECE_BYTES: usize = 64 * 1024;
const PIECE_INTERVAL: Duration = Duration::from_millis(131);
/// Length of an upload: it does not end while the test runs.
const UPLOAD_BYTES: usize = 1 << 30;
/// Slow or idle clients of each of the four kinds.
const SLOW_OF_EACH: usize = 250;
/// Time between two people who sign in.
const SIGN_IN_INTERVAL: Duration = Duration::from_millis(500);
/// Time of each measurement.
const MEASURE_TIME: Duration = Duration::from_secs(40);
/// Time after the start of the load that does not count: all clients connect at once, which no morning does.
const START_TIME: Duration = Duration::from_secs(10);
/// Pause between two requests of the measurement.
const REQUEST_INTERVAL: Duration = Duration::from_millis(20);
/// Maximum ratio of the 99th percentiles with and without load, and what the load may add beyond it. Both programs and
/// all clients share the processors, so that a request may wait for one time slice of the scheduler.
const MAX_RATIO: u32 = 2;
const SLACK: Duration = Duration::from_millis(10);
/// Maximum memory of the service without its child processes.
const MAX_MEMORY_KIB: u64 = 256 * 1024;

/// The routes that people read all the time.
const READ: [(&str, &str); 5] = [
    ("sessions", "/api/v1/sessions"),
    ("trainees", "/api/v1/trainees"),
    ("progress", "/api/v1/trainees/ada/progress?task=pegs"),
    ("page", "/"),
    ("script", "/app.js"),
];

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes two minutes and four thousand descriptors: make morning-load"]
async fn a_busy_morning_leaves_reading_quick_and_the_service_small() {
    rlimit::increase_nofile_limit(16_384).unwrap();
    let Some(scene) = Scene::in_folder(Folder::of("--seed 5 --seconds 4 --size 640x360")) else { return };
    let centre = Centre::open().await;
    for person in 0..PEOPLE {
        let login = format!("person-{person}");
        let trainee = centre.request(Method::POST, "/trainees").json(&json!({"name": login, "code": login}));
        let trainee = json_of(trainee.send().await.unwrap()).await;
        add_account(&centre, json!({"login": login, "role": "trainee", "trainee": trainee["id"]})).await;
    }
    for watching in 0..WATCHING {
        add_account(&centre, json!({"login": format!("staff-{watching}"), "role": "administrator"})).await;
    }
    let idle = measure_apart(&centre).await;
    let mut load = JoinSet::new();
    let recording = start_recording(&centre, Arc::new(scene), &mut load).await;
    for kind in [Slow::Silent, Slow::Head, Slow::Body, Slow::NotReading] {
        for _ in 0..SLOW_OF_EACH {
            load.spawn(run_slow_client(kind, centre.host(), centre.token().to_owned()));
        }
    }
    let cookies = sign_in_all(&centre, "person", PEOPLE).await;
    let staff = sign_in_all(&centre, "staff", WATCHING).await;
    for number in 0..BROWSERS {
        load.spawn(show_live(centre.host(), staff[number % WATCHING].clone(), recording.clone(), number));
    }
    for number in 0..UPLOADS {
        load.spawn(upload(centre.host(), cookies[number % PEOPLE].clone(), number % PEOPLE));
    }
    load.spawn(sign_in_for_ever(centre.host()));
    let_time_pass(START_TIME).await;
    let busy = measure_apart(&centre).await;
    let memory_kib: u64 = centre.process().status("VmRSS").parse().unwrap();
    let peak_kib: u64 = centre.process().status("VmHWM").parse().unwrap();
    println!("memory of the service: {} MiB, peak {} MiB", memory_kib / 1024, peak_kib / 1024);
    println!("| route | p50 idle, ms | p99 idle, ms | p50 busy, ms | p99 busy, ms |");
    println!("|---|---|---|---|---|");
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    for ((name, _), (idle, busy)) in READ.iter().zip(idle.iter().zip(&busy)) {
        println!("| {name} | {:.1} | {:.1} | {:.1} | {:.1} |", ms(idle.0), ms(idle.1), ms(busy.0), ms(busy.1));
    }
    while let Some(ended) = load.try_join_next() {
        ended.expect("no client of the load failed");
    }
    assert!(load.len() >= 4 * SLOW_OF_EACH + BROWSERS + UPLOADS, "all clients are still there");
    assert!(peak_kib <= MAX_MEMORY_KIB, "peak {peak_kib} KiB");
    for ((name, _), (idle, busy)) in READ.iter().zip(idle.iter().zip(&busy)) {
        assert!(busy.1 <= MAX_RATIO * idle.1 + SLACK, "{name}: {busy:?} beside {idle:?}");
    }
}

/// The class's password.
const PASSWORD: &str = "a long class password";

/// [`measure`] on a thread of its own, so that its answers do not wait behind those of the load's clients.
async fn measure_apart(centre: &Centre) -> Vec<(Duration, Duration)> {
    let (host, token) = (centre.host(), centre.token().to_owned());
    let measurement = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(measure(&host, &token))
    };
    tokio::task::spawn_blocking(measurement).await.unwrap()
}

/// Median and 99th percentile of each route of [`READ`].
async fn measure(host: &str, token: &str) -> Vec<(Duration, Duration)> {
    let mut times = vec![Vec::new(); READ.len()];
    let (begun, http) = (Instant::now(), Client::new());
    while begun.elapsed() < MEASURE_TIME {
        for ((_, path), times) in READ.iter().zip(&mut times) {
            let_time_pass(REQUEST_INTERVAL).await;
            let asked = Instant::now();
            let request = http.get(format!("http://{host}{path}")).bearer_auth(token);
            let answer = request.send().await.unwrap();
            assert_eq!(answer.status(), StatusCode::OK, "{path}");
            answer.bytes().await.unwrap();
            times.push(asked.elapsed());
        }
    }
    let of_route = |mut times: Vec<Duration>| {
        times.sort();
        (times[times.len() / 2], times[times.len() * 99 / 100])
    };
    times.into_iter().map(of_route).collect()
}

/// Starts a box that sends its recording in real time until the test ends. Returns the recording's session.
async fn start_recording(centre: &Centre, scene: Arc<Scene>, load: &mut JoinSet<()>) -> String {
    let mut headers = reqwest::header::HeaderMap::new();
    headers.insert("authorization", format!("Bearer {}", centre.token()).parse().unwrap());
    let mut sender = open_at(&centre.host(), &headers, "box-1").await.unwrap();
    let mut message = hello("0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44");
    (message["task"], message["codec"]) = (json!("pegs"), json!("h264"));
    (message["width"], message["height"]) = (json!(scene.size.0), json!(scene.size.1));
    sender.send_json(&message).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    load.spawn(async move {
        sender.send_in_real_time(&scene.frames).await;
    });
    welcome["session"].as_str().unwrap().to_owned()
}

/// Creates an account, whose password is [`PASSWORD`].
async fn add_account(centre: &Centre, mut account: Value) {
    account["password"] = json!(PASSWORD);
    account["name"] = account["login"].clone();
    json_of(centre.create_signed_in("/people", &account).await).await;
}

/// Signs people in, all at once. Returns their cookies, by the numbers in their logins.
async fn sign_in_all(centre: &Centre, name: &'static str, count: usize) -> Vec<String> {
    let mut people = JoinSet::new();
    for number in 0..count {
        let host = centre.host();
        people.spawn(async move { (number, sign_in(&host, &format!("{name}-{number}")).await) });
    }
    let mut cookies = people.join_all().await;
    cookies.sort();
    cookies.into_iter().map(|(_, cookie)| cookie).collect()
}

/// Signs a person in and returns the cookie.
async fn sign_in(host: &str, login: &str) -> String {
    let body = json!({"login": login, "password": PASSWORD});
    let answer = Client::new().post(format!("http://{host}/api/v1/sign-in")).json(&body).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    answer.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned()
}

/// One person after another signs in.
async fn sign_in_for_ever(host: String) {
    for number in 0.. {
        sign_in(&host, &format!("person-{}", number % PEOPLE)).await;
        let_time_pass(SIGN_IN_INTERVAL).await;
    }
}

/// A browser that shows *Live*: reads its event stream and all messages about the recording.
async fn show_live(host: String, cookie: String, session: String, number: usize) {
    let request = Client::new().get(format!("http://{host}/api/v1/events")).header("cookie", &cookie);
    let answer = request.send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK, "event stream of browser {number}");
    let mut events = answer.bytes_stream();
    let mut request = format!("ws://{host}/api/v1/sessions/{session}/live").into_client_request().unwrap();
    request.headers_mut().insert("cookie", cookie.parse().unwrap());
    let (mut socket, _) = connect_async_with_config(request, Some(short_messages()), false).await.unwrap();
    loop {
        tokio::select! {
            event = events.next() => assert!(event.is_some_and(|event| event.is_ok()), "browser {number}: event stream"),
            message = socket.next() => assert!(message.is_some_and(|m| m.is_ok()), "browser {number}: live view"),
        }
    }
}

/// A person's recording arrives slowly and for a long time.
async fn upload(host: String, cookie: String, person: usize) {
    let pieces = futures_util::stream::unfold((), |()| async {
        let_time_pass(PIECE_INTERVAL).await;
        Some((Ok::<_, std::io::Error>(vec![7_u8; PIECE_BYTES]), ()))
    });
    let query = format!("trainee=person-{person}&task=pegs&box=box-1&filename=long.mp4");
    let request = Client::new().post(format!("http://{host}/api/v1/sessions?{query}"));
    let request = request.header("cookie", cookie).header("content-type", "video/mp4");
    let request = request.header("content-length", UPLOAD_BYTES).body(reqwest::Body::wrap_stream(pieces));
    let answer = request.send().await;
    panic!("the upload of person {person} ended: {answer:?}");
}
