//! Paths of long sessions: many requests at once need little memory, and no caller keeps the others waiting.

use std::time::Duration;

use nalgebra::{Point2, Point3, Vector3};
use reqwest::{Response, StatusCode, header};
use tokio::task::JoinSet;
use trocar::analysis::paths::SessionPaths;
use trocar::settings::Settings;
use trocar::vision::covariance::PositionCovariance;
use trocar::vision::trajectory::{Sample, SampleState};

use super::centre::{Centre, PASSWORD};
use crate::planted::Planter;
use crate::process::Process;
use crate::support::{ADMINISTRATOR, Client, Service, poll, problem};

/// Frames of the session, about 17 minutes of two tools. Its table as text has more bytes than the buffers of a
/// connection.
const FRAMES: u64 = 30_000;

/// Maximum memory that the service takes for all of the answers at the same time. The table alone has 20 MiB as text, and
/// 12 MiB as rows in memory.
const MAX_GROWTH_KIB: u64 = 64 * 1024;

fn long_paths() -> SessionPaths {
    let row = |frame: u64, tool: usize| {
        let part = frame as f64 / 7.0;
        Sample {
            frame,
            time_s: frame as f64 * 0.04,
            tool,
            tip_mm: Point3::new(part.sin(), part.cos(), 150.0 + part.sin()),
            velocity_mm_s: Some(Vector3::new(part.cos(), part.sin(), part.tan())),
            axis: Some(Vector3::new(part.sin(), part.cos(), 0.0)),
            tip_px: Some(Point2::new(100.0 * part.sin(), 100.0 * part.cos())),
            covariance_mm2: Some(PositionCovariance::from_sigmas(0.1 + part.cos().abs(), 0.5)),
            state: SampleState::Observed,
        }
    };
    SessionPaths {
        tools: vec!["orange".to_owned(), "cyan".to_owned()],
        frame_times_s: (0..FRAMES).map(|frame| frame as f64 * 0.04).collect(),
        raw: Vec::new(),
        filtered: Vec::new(),
        smoothed: (0..FRAMES).flat_map(|frame| [row(frame, 0), row(frame, 1)]).collect(),
        tracking: None,
        cuts: Vec::new(),
    }
}

/// A centre where ada has a long session, and the address of its path.
async fn centre_with_long_session(change: impl FnOnce(&mut Settings)) -> (Centre, String) {
    let centre = Centre::open_in(Service::start_with(change).await).await;
    let data = centre.service.data.path();
    let planter = Planter::open(&data.join("trocar.db")).await;
    let session = planter.paths(planter.trainee("ada").await, data, &long_paths()).await;
    (centre, format!("/api/v1/sessions/{session}/trajectory"))
}

#[tokio::test(flavor = "multi_thread")]
async fn nine_answers_at_once_take_little_memory() {
    let (centre, path) = centre_with_long_session(|_| ()).await;
    let data = centre.service.stop().await;
    let service = Process::start(data.path());
    let stranger = Client::of(format!("http://{}", service.address));
    let mut clients = Vec::new();
    for (login, password) in [("ada", PASSWORD), ("ines", PASSWORD), ADMINISTRATOR] {
        clients.push(stranger.clone().signed_in(login, password).await);
    }
    let peak_kib = || service.status("VmHWM").parse::<u64>().unwrap();
    let before = peak_kib();
    let mut answers = JoinSet::new();
    for client in &clients {
        for query in ["format=csv", "format=parquet", "points=4000"] {
            let (client, address) = (client.clone(), format!("{path}?{query}"));
            answers.spawn(async move {
                let answer = client.get(&address).await;
                (answer.status(), answer.bytes().await.unwrap().len())
            });
        }
    }
    let sizes = answers.join_all().await;
    assert!(sizes.iter().all(|(status, bytes)| *status == StatusCode::OK && *bytes > 1 << 19), "{sizes:?}");
    let grown = peak_kib() - before;
    eprintln!("nine answers took {} MiB", grown / 1024);
    assert!(grown <= MAX_GROWTH_KIB, "{grown} KiB");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_is_erased_while_its_path_waits_for_a_slot_is_not_sent() {
    let (centre, path) = centre_with_long_session(|settings| settings.http.max_heavy_answers_of_one = 1).await;
    let first = centre.trainee.get(&format!("{path}?format=csv")).await;
    let (client, part) = (centre.trainee.clone(), format!("{path}?from_frame=29990"));
    let mut second = tokio::spawn(async move { client.get(&part).await });
    let waited = tokio::time::timeout(Duration::from_millis(200), &mut second).await;
    assert!(waited.is_err(), "it waits for the slot");
    let erased = centre.administrator.delete(path.trim_end_matches("/trajectory")).await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    drop(first); // the client disconnects, and the slot is free
    problem(second.await.unwrap(), 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_caller_with_unread_answers_is_refused_and_others_are_served_until_all_slots_are_taken() {
    let few_slots = |settings: &mut Settings| {
        settings.http.max_heavy_answers = 2;
        settings.http.max_heavy_answers_of_one = 1;
        settings.http.heavy_answer_wait_s = 0.05;
    };
    let (centre, path) = centre_with_long_session(few_slots).await;
    let whole = format!("{path}?format=csv");
    let part = format!("{path}?from_frame=29990");
    let open = async |client: &Client| {
        let answer = client.get(&whole).await;
        assert_eq!(answer.status(), StatusCode::OK);
        answer
    };
    let says_when = |answer: &Response| assert!(answer.headers().contains_key(header::RETRY_AFTER));
    let of_trainee = open(&centre.trainee).await;
    let refused = centre.trainee.get(&part).await;
    says_when(&refused);
    assert_eq!(problem(refused, 429, "too-many").await["limit"], 1);
    let read = centre.instructor.read(&part).await;
    assert_eq!(read["columns"]["frame"].as_array().map(Vec::len), Some(20));

    let of_instructor = open(&centre.instructor).await;
    let refused = centre.administrator.get(&part).await;
    says_when(&refused);
    problem(refused, 503, "busy").await;

    drop(of_trainee); // the client disconnects
    let served = async || (centre.administrator.get(&part).await.status() == StatusCode::OK).then_some(());
    poll("a slot", served).await;
    assert!(of_instructor.text().await.unwrap().lines().count() as u64 == 1 + 2 * FRAMES, "it is whole");
}
