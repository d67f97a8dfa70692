//! Many people at once: enrolment of lists, group tables, distributions with a limit, people who need attention, and
//! the state of the service.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, Planter, duration};
use crate::support::{Service, problem, read};
use trocar::motion::PIPELINE_VERSION;
use trocar::settings::Settings;
use trocar::time::{Clock, ManualClock, SystemClock, to_rfc3339};

const ENROLMENTS: &str = "/api/v1/enrolments";

async fn planter(centre: &Centre) -> Planter {
    Planter::open(&centre.service.data.path().join("trocar.db")).await
}

async fn set_standard(centre: &Centre, seconds: f64, rule: Value) {
    let by = json!({"method": "fixed", "limit": seconds, "unit": "s"});
    let body = json!({"targets": [{"feature": "duration", "by": by}], "rule": rule});
    centre.administrator.make("/api/v1/tasks/peg/standards", body).await;
}

async fn group(centre: &Centre, name: &str) -> String {
    let groups = centre.administrator.read("/api/v1/groups").await;
    let found = groups["items"].as_array().unwrap().iter().find(|group| group["name"] == name).unwrap();
    found["id"].as_str().unwrap().to_owned()
}

fn now_ms() -> i64 {
    SystemClock.now_ms()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_list_is_enrolled_whole_or_not_at_all() {
    let centre = Centre::open().await;
    let good = json!({"name": "Cleo", "code": "cleo", "level": "Novice", "handedness": "left", "group": "One"});
    let bad = json!([good, {"name": "Dan", "code": "ada"}, {"name": "", "group": "Three"}, {"name": "Eve", "group": "Three"}]);
    let rows_and_fields = |problems: &Value| -> Vec<(u64, String)> {
        let of = |row: &Value| (row["row"].as_u64().unwrap(), row["field"].as_str().unwrap().to_owned());
        problems.as_array().unwrap().iter().map(of).collect()
    };
    // Problems within the rows and conflicts with the data of the centre are reported together.
    let checked = centre.administrator.post(ENROLMENTS, json!({"rows": bad, "only_check": true})).await;
    let expected = [(2, "code"), (3, "name"), (3, "group"), (4, "group")].map(|(row, field)| (row, field.to_owned()));
    assert_eq!(rows_and_fields(&read(checked, StatusCode::OK).await["problems"]), expected);
    let bad = json!([good, {"name": "Dan", "code": "ada"}, {"name": "Eve", "group": "Three"}]);
    let refused = problem(centre.administrator.post(ENROLMENTS, json!({"rows": bad})).await, 422, "invalid").await;
    assert_eq!(rows_and_fields(&refused["problems"]), [(2, "code".to_owned()), (3, "group".to_owned())], "{refused}");
    assert!(refused["detail"].as_str().unwrap().starts_with("2 rows cannot be used"), "{refused}");
    assert_eq!(centre.administrator.read("/api/v1/trainees").await["items"].as_array().unwrap().len(), 2);

    // A generated code avoids the codes that later rows state.
    let rows = json!([{"name": "Dan"}, {"name": "Danica", "code": "dan"}, good]);
    let checked = centre.administrator.post(ENROLMENTS, json!({"rows": rows, "only_check": true})).await;
    assert_eq!(
        read(checked, StatusCode::OK).await,
        json!({"enrolled": [], "problems": [], "new_groups": [], "invitations": []})
    );
    assert_eq!(centre.administrator.read("/api/v1/trainees").await["items"].as_array().unwrap().len(), 2);
    let done = read(centre.administrator.post(ENROLMENTS, json!({"rows": rows})).await, StatusCode::OK).await;
    let codes: Vec<&str> = done["enrolled"].as_array().unwrap().iter().map(|of| of["code"].as_str().unwrap()).collect();
    assert_eq!(codes, ["dan-2", "dan", "cleo"]);
    assert_eq!(centre.instructor.read("/api/v1/trainees/cleo").await["handedness"], "left", "she is in group one");
}

#[tokio::test(flavor = "multi_thread")]
async fn people_with_the_same_name_get_different_codes() {
    let centre = Centre::open().await;
    let rows: Vec<Value> = (0..100).map(|_| json!({"name": "王芳"})).collect(); // no letter of it may be in a code
    let mut codes = Vec::new();
    for _ in 0..2 {
        let done = read(centre.administrator.post(ENROLMENTS, json!({"rows": rows})).await, StatusCode::OK).await;
        let made = done["enrolled"].as_array().unwrap().iter().map(|of| of["code"].as_str().unwrap().to_owned());
        codes.extend(made);
    }
    let wanted = (2..=200).map(|number| format!("trainee-{number}"));
    let wanted: Vec<String> = std::iter::once("trainee".to_owned()).chain(wanted).collect();
    assert_eq!(codes, wanted);
}

#[tokio::test(flavor = "multi_thread")]
async fn instructors_enrol_only_into_their_own_groups() {
    let centre = Centre::open().await;
    let rows = |group: Value| json!({"rows": [{"name": "Cleo", "group": group}]});
    let foreign = problem(centre.instructor.post(ENROLMENTS, rows(json!("Two"))).await, 422, "invalid").await;
    let missing = problem(centre.instructor.post(ENROLMENTS, rows(json!("Three"))).await, 422, "invalid").await;
    let message = |of: &Value| of["problems"][0]["message"].as_str().unwrap().replace("Two", "Three");
    assert_eq!(message(&foreign), message(&missing), "a hidden group looks like a missing one");
    read(centre.instructor.post(ENROLMENTS, rows(Value::Null)).await, StatusCode::OK).await;
    assert_eq!(
        centre.instructor.read("/api/v1/trainees/cleo").await["name"],
        "Cleo",
        "the instructor's only group is used"
    );
    problem(centre.trainee.post(ENROLMENTS, rows(Value::Null)).await, 403, "forbidden").await;
    problem(centre.administrator.post(ENROLMENTS, json!({"rows": []})).await, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_groups_table_agrees_with_each_trainees_own_progress() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    set_standard(&centre, 50.0, json!({"in_a_row": 2})).await;
    let (ada, start) = (planter.trainee("ada").await, now_ms() - 9 * DAY_MS);
    for (day, seconds) in [70.0, 45.0, 44.0].into_iter().enumerate() {
        planter.session(ada, start + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    planter.result(ada, start + 5 * DAY_MS, vec![duration(40.0, 1.0)], (PIPELINE_VERSION, "refused")).await;
    let one = group(&centre, "One").await;
    let table = centre.instructor.read(&format!("/api/v1/groups/{one}/progress?task=peg")).await;
    let own = centre.instructor.read("/api/v1/trainees/ada/progress?task=peg").await;
    assert_eq!(
        (&table["feature"], &table["unit"], &table["target"]["limit"]),
        (&json!("duration"), &json!("s"), &json!(50.0))
    );
    assert_eq!((table["trainees"].as_array().unwrap().len(), &table["trainees"][0]["code"]), (1, &json!("ada")));
    let row = &table["rows"][0];
    let points = own["features"][0]["points"].as_array().unwrap();
    assert_eq!(row["points"].as_array().unwrap(), &points[..3], "the refused session does not count");
    assert_eq!((&row["sessions"], &row["last_at"]), (&json!(4), &own["sessions"][3]["recorded_at"]));
    assert_eq!((&row["rule"], &row["passed"], &row["newest"]), (&own["rule"], &json!(true), &own["sessions"][2]["id"]));
    let passed =
        json!({"by": "rule", "standard": 1, "session": 3, "at": own["sessions"][2]["recorded_at"], "sessions": [2, 3]});
    assert_eq!(own["passed"], passed);
    // For instructors, the groups of others do not exist. Trainees may not read tables.
    let path = format!("/api/v1/groups/{one}/progress?task=peg");
    problem(centre.other_instructor.get(&path).await, 404, "not-found").await;
    problem(centre.trainee.get(&path).await, 403, "forbidden").await;
    problem(centre.instructor.get(&format!("/api/v1/groups/{one}/progress?task=none")).await, 422, "unknown-reference")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_moved_limit_gives_the_same_shares_as_a_standard_with_that_limit() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    for (level, first) in [("expert", 40.0), ("novice", 60.0)] {
        for number in 0..12 {
            let name = format!("{level}-{number}");
            centre.administrator.make("/api/v1/trainees", json!({"name": name, "level": level})).await;
            let seconds = first + 3.0 * f64::from(number);
            planter.session(planter.trainee(&name).await, now_ms(), vec![duration(seconds, 1.0)]).await;
        }
        centre.administrator.make("/api/v1/cohorts", json!({"name": level, "level": level})).await;
    }
    let by = json!({"method": "contrasting_groups", "novices": "novice", "experts": "expert"});
    let body = json!({"targets": [{"feature": "duration", "by": by}]});
    let made =
        read(centre.administrator.post("/api/v1/tasks/peg/standards/proposals", body).await, StatusCode::OK).await;
    let target = &made["targets"][0]["target"];
    let at =
        |limit: &Value| format!("/api/v1/tasks/peg/distribution?feature=duration&cohorts=novice,expert&limit={limit}");
    let at_limit = centre.administrator.read(&at(&target["limit"])).await;
    assert_eq!(at_limit["groups"][0]["keeping"], target["basis"]["false_pass"], "the share of novices who pass");
    assert_eq!(at_limit["groups"][1]["breaking"], target["basis"]["false_fail"], "the share of experts who fail");
    let milder = centre.administrator.read(&at(&json!(80))).await;
    assert!(
        milder["groups"][0]["keeping"]["seen"].as_f64() > at_limit["groups"][0]["keeping"]["seen"].as_f64(),
        "{milder}"
    );
    let values = at_limit["groups"][1]["values"].as_array().unwrap();
    assert_eq!((values.len(), &values[0], &values[11]), (12, &json!(40.0), &json!(73.0)));

    // Values are limited to trainees in the caller's scope: the instructor's only trainee has no session.
    let seen = centre.instructor.read(&at(&json!(80))).await;
    for group in seen["groups"].as_array().unwrap() {
        assert_eq!((&group["values"], &group["keeping"]), (&json!([]), &Value::Null), "{seen}");
        assert_eq!(group["withheld"]["reason"], "too_few");
    }
    problem(centre.trainee.get(&at(&json!(80))).await, 403, "forbidden").await;
    let wrong = "/api/v1/tasks/peg/distribution?feature=path_length&tool=orange";
    let refused = problem(centre.administrator.get(wrong).await, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "hand");
}

#[tokio::test(flavor = "multi_thread")]
async fn attention_lists_only_people_in_the_callers_scope() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    set_standard(&centre, 50.0, json!({"in_a_row": 2})).await;
    let (ada, bob) = (planter.trainee("ada").await, planter.trainee("bob").await);
    let start = now_ms() - 60 * DAY_MS;
    for day in 0..2 {
        planter.session(ada, start + day * DAY_MS, vec![duration(40.0, 1.0)]).await; // passed; the first month is over
    }
    let missed = (0..30).map(|day| if day < 20 { 40.0 } else { 90.0 });
    for (day, seconds) in missed.enumerate() {
        planter.session(bob, start + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await; // relapses
    }
    planter.result(bob, now_ms(), vec![duration(40.0, 1.0)], (PIPELINE_VERSION, "refused")).await;
    let kinds = |of: &Value| -> Vec<(String, String)> {
        let text = |of: &Value| of.as_str().unwrap().to_owned();
        let mut found: Vec<_> = of["alarms"]
            .as_array()
            .unwrap()
            .iter()
            .map(|one| (text(&one["kind"]), text(&one["trainee_name"])))
            .collect();
        found.sort();
        found
    };
    let all = centre.administrator.read("/api/v1/attention").await;
    let (due, relapsed) = (("due".to_owned(), "ada".to_owned()), ("relapsed".to_owned(), "bob".to_owned()));
    assert_eq!((kinds(&all), &all["more"]), (vec![due.clone(), relapsed.clone()], &json!(false)), "{all}");
    assert_eq!(all["refused"].as_array().unwrap().len(), 1);
    for (client, alarm, refused) in [
        (&centre.instructor, &due, 0),
        (&centre.trainee, &due, 0),
        (&centre.other_instructor, &relapsed, 1),
        (&centre.other_trainee, &relapsed, 1),
    ] {
        let seen = client.read("/api/v1/attention").await;
        assert_eq!((kinds(&seen), seen["refused"].as_array().unwrap().len()), (vec![alarm.clone()], refused), "{seen}");
    }
    problem(centre.agent.get("/api/v1/attention").await, 403, "forbidden").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn unrated_sessions_are_listed_only_for_tasks_that_are_rated() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    let ada = planter.trainee("ada").await;
    for day in 0..2 {
        planter.session(ada, now_ms() - day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    assert_eq!(centre.instructor.read("/api/v1/attention").await["unrated"], json!([]), "this task is not rated");
    let sessions = centre.instructor.read("/api/v1/sessions").await;
    let first = sessions["items"][0]["id"].as_str().unwrap();
    let rating = super::ratings::goals(3);
    centre.instructor.make(&format!("/api/v1/sessions/{first}/ratings"), rating).await;
    let attention = centre.instructor.read("/api/v1/attention").await;
    assert_eq!(
        (attention["unrated"].as_array().unwrap().len(), &attention["unrated"][0]["session"]),
        (1, &sessions["items"][1]["id"])
    );
    assert_eq!(centre.trainee.read("/api/v1/attention").await["unrated"], json!([]), "only staff rate");
}

#[tokio::test(flavor = "multi_thread")]
async fn administrators_read_the_state_of_the_service_and_the_audit_log() {
    let centre = Centre::open().await;
    let service = centre.administrator.read("/api/v1/service").await;
    assert_eq!((&service["pipeline"], &service["last_backup"]), (&json!(PIPELINE_VERSION), &Value::Null));
    assert!(service["storage"]["database_bytes"].as_u64() > Some(100_000), "{service}");
    assert!(service["storage"]["free_bytes"].as_u64() > Some(1_000_000), "{service}");
    assert_eq!(service["settings"]["unfinished_upload_h"], 48);
    centre.instructor.make("/api/v1/tasks", json!({"name": "Cutting"})).await;
    let page = centre.administrator.read("/api/v1/audit-entries?limit=1").await;
    let last = &page["items"][0];
    let entry = (&last["who"], &last["by"], &last["action"], &last["noun"]);
    assert_eq!(entry, (&json!("ines"), &json!("person"), &json!("create"), &json!("task")));
    let cursor = page["next"].as_str().unwrap();
    let next = centre.administrator.read(&format!("/api/v1/audit-entries?limit=1&cursor={cursor}")).await;
    assert!(next["items"][0]["id"].as_i64() < last["id"].as_i64(), "{next}");
    for path in ["/api/v1/service", "/api/v1/audit-entries"] {
        for client in [&centre.instructor, &centre.trainee, &centre.agent] {
            problem(client.get(path).await, 403, "forbidden").await;
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn administrators_see_when_the_last_backup_was_made() {
    const NOW_MS: i64 = 1_800_000_000_000;
    let target = tempfile::tempdir().unwrap();
    let with_backups = |settings: &mut Settings| settings.backup.target = Some(target.path().to_owned());
    let service = Service::start_in(tempfile::tempdir().unwrap(), ManualClock::at(NOW_MS), with_backups).await;
    let administrator = service.administrator().await;
    let has_backup =
        |state: &Value| !state["last_backup"].is_null() && !state["scheduled_backups"]["newest_at"].is_null();
    let state = administrator.read_until("/api/v1/service", has_backup).await;
    let made = json!(to_rfc3339(NOW_MS));
    assert_eq!((&state["last_backup"]["at"], &state["scheduled_backups"]["newest_at"]), (&made, &made));
    assert!(state["last_backup"]["files"].is_u64(), "{state}");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn administrators_see_that_erasures_cannot_be_listed_and_that_backups_are_of_another_service() {
    let target = tempfile::tempdir().unwrap();
    let foreign = target.path().join("trocar-2026-11-01T02-30-00Z");
    std::fs::create_dir(&foreign).unwrap();
    let list = target.path().join("erasures");
    let line = "trainee 0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44 2026-11-21T20:14:00Z\n";
    std::fs::write(&list, format!("{line}garbage\n")).unwrap();
    let service = Service::start_with(|settings| {
        settings.upkeep.collect_s = 1;
        settings.backup.target = Some(target.path().to_owned());
    })
    .await;
    let administrator = service.administrator().await;
    let is_failing =
        |state: &Value| !state["erasure_list_error"].is_null() && state["scheduled_backups"]["others"] == 1;
    let state = administrator.read_until("/api/v1/service", is_failing).await;
    let error = state["erasure_list_error"].as_str().unwrap();
    assert!(error.contains(list.to_str().unwrap()) && error.contains("line 2 is damaged"), "{error}");
    std::fs::write(&list, line).unwrap();
    administrator.read_until("/api/v1/service", |state| state["erasure_list_error"].is_null()).await;
    assert!(foreign.exists());
    service.stop().await;
}
