//! The cost of a trainee's progress: 500 sessions of one trainee among 10,000, with a fitted curve and a rank among
//! everyone. The same run also requests `/healthz`. `make progress-load` prints the times; no test depends on them.

use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::json;
use trocar::domain::feature::FeatureInfo;
use trocar::domain::session::FeatureRow;
use trocar::ids::TraineeId;

use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, measured};
use crate::process::Process;
use crate::support::{ADMINISTRATOR, Client, Service, let_time_pass, read};

/// Sessions of the measured trainee, and of all others together.
const OWN: usize = 500;
const OTHERS: usize = 9_500;
/// Number of the other trainees.
const PEOPLE: usize = 190;
/// Sessions that are planted at the same time, so that they share commits.
const AT_ONCE: usize = 32;
/// Measured requests of each kind, and requests before them that only fill caches.
const REQUESTS: usize = 400;
const WARM_UP: usize = 10;
/// Pause between two requests of one kind.
const PAUSE: Duration = Duration::from_millis(20);

const PROGRESS: &str = "/api/v1/trainees/ada/progress?task=peg&cohort=everybody";

#[tokio::test(flavor = "multi_thread")]
#[ignore = "fills a database for minutes: make progress-load"]
async fn what_progress_costs_among_10000_sessions() {
    let started = Instant::now();
    let service = Service::start().await;
    fill(&service).await;
    println!("{OWN} sessions of one trainee and {OTHERS} of {PEOPLE} others, planted in {:.0?}", started.elapsed());
    let data = service.stop().await;
    let database = std::fs::metadata(data.path().join("trocar.db")).unwrap().len();
    println!("database: {:.0} MB", database as f64 / 1e6);

    let process = Process::start(data.path());
    let base = format!("http://{}", process.address);
    let client = Client::of(base).signed_in(ADMINISTRATOR.0, ADMINISTRATOR.1).await;
    let shown = client.read(PROGRESS).await;
    let (sessions, series) = (shown["sessions"].as_array().unwrap().len(), &shown["features"][0]);
    assert_eq!((sessions, &series["place"]["people"]), (OWN, &json!(PEOPLE)), "{series}");
    assert_eq!((&series["learning"]["state"], &shown["charts"]["standing"]), (&json!("curve"), &json!("proficient")));
    println!("| asked | answers | bytes | median, ms | 95 %, ms | 99 %, ms | most, ms |");
    println!("|---|---|---|---|---|---|---|");
    println!("{}", row("/healthz, alone", ask(&client, "/healthz", REQUESTS).await));
    println!("{}", row("progress, alone", ask(&client, PROGRESS, REQUESTS).await));
    let (health, progress) = tokio::join!(ask(&client, "/healthz", REQUESTS), ask(&client, PROGRESS, REQUESTS));
    println!("{}", row("/healthz, beside progress", health));
    println!("{}", row("progress, beside /healthz", progress));
    let of_both_tools = format!("{PROGRESS}&feature=path_length");
    println!("{}", row("two tools' feature: two curves", ask(&client, &of_both_tools, REQUESTS / 4).await));
    let no_curve = format!("{PROGRESS}&feature=tip_distance"); // neither more nor less of it is better
    println!("{}", row("two tools' feature without curves", ask(&client, &no_curve, REQUESTS / 4).await));
}

/// The time of each answer, ms, and the size of the last one, bytes.
async fn ask(client: &Client, path: &str, times: usize) -> (Vec<f64>, usize) {
    let (mut took, mut bytes) = (Vec::with_capacity(times), 0);
    for number in 0..WARM_UP + times {
        let started = Instant::now();
        let answer = client.get(path).await;
        assert_eq!(answer.status(), StatusCode::OK);
        bytes = answer.bytes().await.unwrap().len();
        if number >= WARM_UP {
            took.push(started.elapsed().as_secs_f64() * 1e3);
        }
        let_time_pass(PAUSE).await; // keeps the rate of requests even
    }
    (took, bytes)
}

fn row(what: &str, (mut took, bytes): (Vec<f64>, usize)) -> String {
    took.sort_by(f64::total_cmp);
    let at = |share: f64| took[((took.len() - 1) as f64 * share).round() as usize];
    let count = took.len();
    format!("| {what} | {count} | {bytes} | {:.1} | {:.1} | {:.1} | {:.1} |", at(0.5), at(0.95), at(0.99), at(1.0))
}

/// Fills the centre with the sessions, a standard and a cohort of everyone.
async fn fill(service: &Service) {
    let administrator = service.administrator().await;
    administrator.make("/api/v1/boxes", json!({"name": "Box 1", "code": "box-1"})).await;
    administrator.make("/api/v1/tasks", json!({"name": "Peg transfer", "code": "peg"})).await;
    administrator.make("/api/v1/cohorts", json!({"name": "Everybody"})).await;
    let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": 55, "unit": "s"}});
    let standard = json!({"targets": [target], "rule": {"in_a_row": 2, "then_more": 10}});
    let set = administrator.post("/api/v1/tasks/peg/standards", standard).await;
    read(set, StatusCode::CREATED).await;
    let planter = Planter::open(&service.data.path().join("trocar.db")).await;
    administrator.make("/api/v1/trainees", json!({"name": "Ada", "code": "ada", "handedness": "right"})).await;
    let mut planted: Vec<(TraineeId, usize, usize)> = Vec::new();
    let ada = planter.trainee("ada").await;
    planted.extend((0..OWN).map(|session| (ada, 0, session)));
    for person in 1..=PEOPLE {
        let code = format!("other-{person}");
        let body = json!({"name": code, "code": code, "handedness": "right"});
        administrator.make("/api/v1/trainees", body).await;
        let id = planter.trainee(&code).await;
        planted.extend((0..OTHERS / PEOPLE).map(|session| (id, person, session)));
    }
    for some in planted.chunks(AT_ONCE) {
        let row = |(trainee, person, session): &(TraineeId, usize, usize)| {
            let at_ms = NEW_YEAR_MS + *session as i64 * DAY_MS / 4 + *person as i64;
            (*trainee, at_ms, features(*person, *session))
        };
        planter.sessions(some.iter().map(row).collect()).await;
    }
}

/// Every feature of a session, falling to a level that differs from person to person.
fn features(person: usize, session: usize) -> Vec<FeatureRow> {
    let noise = |salt: usize| {
        let mixed = (person * 7919 + session * 104_729 + salt * 1_299_709).wrapping_mul(2_654_435_761) >> 7;
        (mixed % 1000) as f64 / 500.0 - 1.0
    };
    let learnt = |start: f64, level: f64, salt: usize| {
        let level = level * (1.0 + (person % 17) as f64 / 40.0);
        level + (start - level) * (-(session as f64) / 25.0).exp() + 0.12 * level * (noise(salt) + noise(salt + 50))
    };
    let mut rows = vec![duration(learnt(150.0, 45.0, 0), 0.4)];
    for (salt, info) in FeatureInfo::all().into_iter().enumerate() {
        for (hand, tool) in ["orange", "blue"].into_iter().enumerate() {
            for space in &info.spaces {
                let value = learnt(3.0, 1.0, 2 * salt + hand + 1);
                rows.push(measured(info.name, info.unit, Some(tool), *space, value, 0.05));
            }
        }
    }
    rows
}
