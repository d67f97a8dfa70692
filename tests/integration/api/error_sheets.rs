//! Errors that raters count: lists, formulas, sheets, scores and agreement, as raters, trainees and strangers see them.

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::motion::PIPELINE_VERSION;

use super::centre::{Centre, PASSWORD, recording, session};
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::support::{Client, problem, read};

const LISTS: &str = "/api/v1/tasks/peg/error-lists";
pub(super) const FORMULAS: &str = "/api/v1/tasks/peg/score-formulas";

/// Drops (counted), a deviation in mm, and a slipping knot (yes or no).
fn items() -> Value {
    json!({"items": [{"name": "Drops", "kind": "count"}, {"name": "Deviation", "kind": "amount", "unit": "mm"},
                     {"name": "Knot slips", "kind": "yes_no"}]})
}

/// Cut-off 300 s, 10 for each drop, 2 for each mm; scaled to 100.
fn formula() -> Value {
    json!({"cut_off_s": 300, "time": "measured", "not_below_zero": true,
           "weights": [{"item": "drops", "weight": 10}, {"item": "deviation", "weight": 2}],
           "scale": {"norm": 300, "maximum": 100, "not_above": true}})
}

/// A centre whose task has items and a formula, and a session of Ada with a duration of 145.2 ± 0.4 s.
pub(super) struct Prepared {
    pub centre: Centre,
    pub planter: Planter,
    pub at: String,
}

pub(super) async fn prepared() -> Prepared {
    let centre = Centre::open().await;
    centre.instructor.make(LISTS, items()).await;
    centre.instructor.make(FORMULAS, formula()).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    planter.session(ada, NEW_YEAR_MS, vec![duration(145.2, 0.4)]).await;
    let list = centre.trainee.read("/api/v1/sessions").await;
    let at = format!("/api/v1/sessions/{}", list["items"][0]["id"].as_str().unwrap());
    Prepared { centre, planter, at }
}

/// A second instructor of group one, signed in.
pub(super) async fn colleague(centre: &Centre) -> Client {
    let groups = centre.administrator.read("/api/v1/groups").await;
    let group = groups["items"].as_array().unwrap().iter().find(|row| row["name"] == "One").unwrap()["id"].clone();
    let account =
        json!({"login": "iris", "name": "Iris", "role": "instructor", "password": PASSWORD, "groups": [group]});
    centre.administrator.make("/api/v1/people", account).await;
    centre.service.sign_in("iris", PASSWORD).await
}

async fn ok(response: reqwest::Response) -> Value {
    read(response, StatusCode::OK).await
}

/// Fills in and finishes a sheet.
pub(super) async fn rate(by: &Client, at: &str, drops: usize, deviation_mm: Option<f64>) -> Value {
    by.make(&format!("{at}/error-sheets"), json!({})).await;
    for number in 0..drops {
        by.make(&format!("{at}/error-marks"), json!({"item": "drops", "at_s": number + 1})).await;
    }
    let amounts = deviation_mm.map_or(json!({}), |mm| json!({"deviation": mm}));
    ok(by.put(&format!("{at}/error-sheet"), json!({"amounts": amounts})).await).await;
    ok(by.post(&format!("{at}/error-sheet/finish"), json!({})).await).await
}

async fn score(by: &Client, at: &str) -> Value {
    by.read(&format!("{at}/error-sheets")).await["score"].clone()
}

fn assert_close(got: &Value, want: f64) {
    assert!((got.as_f64().unwrap() - want).abs() < 1e-6, "{got} is not {want}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sheet_is_tapped_undone_and_finished_and_gives_the_hand_computed_score() {
    let Prepared { centre, at, .. } = prepared().await;
    let (rater, sheets, marks) = (&centre.instructor, format!("{at}/error-sheets"), format!("{at}/error-marks"));
    assert_eq!(score(rater, &at).await["none"]["reason"], "no_sheet", "not rated is not zero");
    problem(rater.post(&marks, json!({"item": "drops"})).await, 409, "conflict").await;
    let begun = rater.make(&sheets, json!({})).await;
    assert_eq!((&begun["finished_at"], &begun["own"], &begun["list"]), (&Value::Null, &json!(true), &json!(1)));
    assert_eq!(rater.make(&sheets, json!({})).await["id"], begun["id"], "the open sheet is returned");
    for at_s in [12.5, 3.25, 99.0] {
        rater.make(&marks, json!({"item": "drops", "at_s": at_s})).await;
    }
    let open = rater.read(&sheets).await["open"].clone();
    assert_eq!((&open["marks"][0]["at_s"], &open["values"][0]["value"]), (&json!(3.25), &json!(3.0)));
    let last = format!("{marks}/{}", open["marks"][2]["id"].as_str().unwrap());
    assert_eq!(rater.delete(&last).await.status(), StatusCode::NO_CONTENT);
    problem(rater.delete(&last).await, 404, "not-found").await;
    rater.make(&marks, json!({"item": "knot-slips"})).await;
    problem(rater.post(&marks, json!({"item": "knot-slips"})).await, 409, "conflict").await;
    ok(rater.put(&format!("{at}/error-sheet"), json!({"amounts": {"deviation": 1.5}, "time_s": 150})).await).await;
    // An open sheet says nothing, to its rater, to others and to the trainee.
    for client in [rater, &centre.administrator, &centre.trainee] {
        assert_eq!(score(client, &at).await["none"]["reason"], "no_sheet");
    }
    assert_eq!(centre.trainee.read(&sheets).await["open"], Value::Null);
    let finished = ok(rater.post(&format!("{at}/error-sheet/finish"), json!({})).await).await;
    assert_eq!((&finished["blind"], &finished["values"][2]["value"]), (&json!(true), &json!(1.0)));
    // 300 − 145.2 − 10 × 2 − 2 × 1.5 = 131.8 points, and 131.8 / 300 × 100 = 43.9333; the bar is that of the time.
    let seen = score(&centre.trainee, &at).await;
    assert_close(&seen["score"]["points"], 131.8);
    assert_close(&seen["score"]["value"], 43.933_333_333);
    assert_close(&seen["score"]["low"], 43.8);
    assert_close(&seen["score"]["high"], 44.066_666_667);
    assert_eq!((&seen["score"]["sheets"], &seen["formula"]["version"]), (&json!(1), &json!(1)));
    problem(rater.post(&marks, json!({"item": "drops"})).await, 409, "conflict").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn raters_are_blind_until_they_have_finished_and_a_correction_replaces_a_sheet() {
    let Prepared { centre, at, .. } = prepared().await;
    let (second, sheets) = (colleague(&centre).await, format!("{at}/error-sheets"));
    rate(&centre.instructor, &at, 1, Some(0.0)).await;
    for client in [&second, &centre.administrator] {
        let seen = client.read(&sheets).await;
        assert_eq!((&seen["items"], &seen["hidden"]), (&json!([]), &json!(1)));
        assert_eq!(seen["score"]["none"]["reason"], "hidden", "the score would tell the errors");
        let body = json!({"formula": formula(), "session": at.rsplit('/').next()});
        let tried = ok(client.post(&format!("{FORMULAS}/previews"), body).await).await;
        assert_eq!(tried["none"]["reason"], "hidden");
    }
    let given = rate(&second, &at, 3, Some(0.0)).await;
    assert_eq!(given["blind"], true);
    let seen = second.read(&sheets).await;
    assert_eq!((seen["items"].as_array().unwrap().len(), &seen["hidden"]), (2, &json!(0)));
    // Penalties 10 and 30: 300 − 145.2 − 20 = 134.8 points.
    let by_two = &seen["score"]["score"];
    assert_close(&by_two["points"], 134.8);
    assert_eq!(
        (&by_two["parts"][0]["mean"], &by_two["parts"][0]["highest"], &by_two["sheets"]),
        (&json!(2.0), &json!(3.0), &json!(2))
    );
    assert_close(&by_two["low"], (300.0 - 145.6 - 30.0) / 3.0);
    assert_close(&by_two["high"], (300.0 - 144.8 - 10.0) / 3.0);

    // A correction begins as a copy. Until it is finished, the sheet before counts.
    let copy = centre.instructor.make(&sheets, json!({})).await;
    assert_eq!((&copy["values"][0]["value"], &copy["values"][1]["value"]), (&json!(1.0), &json!(0.0)));
    centre.instructor.make(&format!("{at}/error-marks"), json!({"item": "drops", "at_s": 7})).await;
    assert_close(&score(&centre.trainee, &at).await["score"]["points"], 134.8);
    let corrected = ok(centre.instructor.post(&format!("{at}/error-sheet/finish"), json!({})).await).await;
    assert_eq!(corrected["blind"], false, "by now the rater could have read the other sheet");
    assert_close(&score(&centre.trainee, &at).await["score"]["points"], 129.8);
    assert_eq!(second.read(&sheets).await["items"].as_array().unwrap().len(), 2, "the latest sheet of each rater");
    // A correction can be discarded.
    centre.instructor.make(&sheets, json!({})).await;
    assert_eq!(centre.instructor.delete(&format!("{at}/error-sheet")).await.status(), StatusCode::NO_CONTENT);
    assert_close(&score(&centre.trainee, &at).await["score"]["points"], 129.8);
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=200").await;
    let count = |action: &str, noun: &str| {
        let is_one = |entry: &&Value| entry["action"] == action && entry["noun"] == noun;
        audit["items"].as_array().unwrap().iter().filter(is_one).count()
    };
    assert_eq!(
        [count("create", "error_sheet"), count("finish", "error_sheet"), count("discard", "error_sheet")],
        [4, 3, 1]
    );
    assert_eq!([count("create", "error_list"), count("create", "score_formula")], [1, 1]);
}

#[tokio::test(flavor = "multi_thread")]
async fn people_without_access_neither_read_nor_fill_in_a_sheet_and_trainees_never_do() {
    let Prepared { centre, at, .. } = prepared().await;
    for client in [&centre.other_instructor, &centre.other_trainee] {
        problem(client.get(&format!("{at}/error-sheets")).await, 404, "not-found").await;
    }
    problem(centre.other_instructor.post(&format!("{at}/error-sheets"), json!({})).await, 404, "not-found").await;
    problem(centre.trainee.post(&format!("{at}/error-sheets"), json!({})).await, 403, "forbidden").await;
    problem(centre.trainee.post(LISTS, items()).await, 403, "forbidden").await;
    problem(centre.trainee.get("/api/v1/tasks/peg/error-agreement").await, 403, "forbidden").await;
    let seen = centre.trainee.read(LISTS).await;
    assert_eq!((&seen["items"][0]["version"], &seen["items"][0]["who"]), (&json!(1), &Value::Null));
}

#[tokio::test(flavor = "multi_thread")]
async fn versions_are_added_and_a_session_is_scored_by_the_one_valid_on_its_day() {
    let Prepared { centre, at, .. } = prepared().await;
    rate(&centre.instructor, &at, 1, Some(0.0)).await;
    let again = centre.instructor.make(LISTS, items()).await;
    assert_eq!(again["version"], 1, "the same list is the same version");
    let mut renamed = items();
    renamed["items"][0] = json!({"item": "drops", "name": "Objects lost", "kind": "count"});
    renamed["items"].as_array_mut().unwrap().truncate(2);
    assert_eq!(centre.instructor.make(LISTS, renamed).await["version"], 2);
    let sheet = centre.trainee.read(&format!("{at}/error-sheets")).await;
    assert_eq!(
        (&sheet["items"][0]["list"], &sheet["list"]["version"]),
        (&json!(1), &json!(2)),
        "a sheet keeps its version"
    );
    assert_close(&sheet["score"]["score"]["points"], 144.8);

    assert_eq!(sheet["score"]["formula"]["valid_from"], Value::Null, "the first version scores all sessions");

    // A version for later days leaves today's session alone; one that begins earlier scores it.
    let later = json!({"valid_from": "2030-01-01", "cut_off_s": 600, "time": "measured"});
    assert_eq!(centre.instructor.make(FORMULAS, later).await["version"], 2);
    assert_eq!(score(&centre.trainee, &at).await["formula"]["version"], 1);
    let earlier = json!({"valid_from": "2025-01-01", "cut_off_s": 200, "time": "measured"});
    assert_eq!(centre.instructor.make(FORMULAS, earlier).await["version"], 3);
    let scored = score(&centre.trainee, &at).await;
    assert_eq!((&scored["formula"]["version"], &scored["formula"]["valid_from"]), (&json!(3), &json!("2025-01-01")));
    assert_close(&scored["score"]["value"], 200.0 - 145.2);
    problem(centre.other_instructor.post("/api/v1/tasks/other/error-lists", items()).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_meant_is_refused_and_names_its_field() {
    let Prepared { centre, at, .. } = prepared().await;
    let rater = &centre.instructor;
    for (path, body, field) in [
        (LISTS, json!({"items": [{"name": "Length", "kind": "amount"}]}), "items"),
        (LISTS, json!({"items": [{"item": "drops", "name": "Drops", "kind": "yes_no"}]}), "items"),
        (LISTS, json!({"items": vec![json!({"name": "A", "kind": "count"}); 13]}), "items"),
        (LISTS, json!({"items": [{"name": "", "kind": "count"}]}), "items[0].name"),
        (FORMULAS, json!({"cut_off_s": -1, "time": "measured"}), "cut_off_s"),
        (FORMULAS, json!({"cut_off_s": 1, "time": "measured", "valid_from": "9999-01-01"}), "valid_from"),
        (FORMULAS, json!({"cut_off_s": 1, "time": "measured", "weights": [{"item": "charm", "weight": 1}]}), "weights"),
        (
            FORMULAS,
            json!({"cut_off_s": 1, "time": "measured", "weights": [{"item": "drops", "weight": -1}]}),
            "weights",
        ),
    ] {
        let refused = problem(rater.post(path, body.clone()).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], field, "{body}: {refused}");
    }
    rater.make(&format!("{at}/error-sheets"), json!({})).await;
    for (body, field) in [
        (json!({"item": "charm"}), "item"),
        (json!({"item": "deviation"}), "item"),
        (json!({"item": "drops", "at_s": -1}), "at_s"),
        (json!({"item": "drops", "at_s": 1e9}), "at_s"),
    ] {
        let refused = problem(rater.post(&format!("{at}/error-marks"), body).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
    }
    for (body, field) in [
        (json!({"amounts": {"deviation": -1}}), "amounts"),
        (json!({"amounts": {"drops": 1}}), "amounts"),
        (json!({"time_s": 0}), "time_s"),
    ] {
        let refused = problem(rater.put(&format!("{at}/error-sheet"), body).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
    }
    // Amounts that were not typed are unknown: no score.
    ok(rater.post(&format!("{at}/error-sheet/finish"), json!({})).await).await;
    assert_eq!(score(rater, &at).await["none"]["reason"], "amount_missing");
    let missing = json!({"formula": formula(), "session": "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44"});
    problem(rater.post(&format!("{FORMULAS}/previews"), missing).await, 422, "unknown-reference").await;
    let typed = json!({"formula": {"cut_off_s": 300, "time": "typed"}, "session": at.rsplit('/').next()});
    let tried = ok(rater.post(&format!("{FORMULAS}/previews"), typed).await).await;
    assert_eq!(tried["none"]["reason"], "time_missing");
    let clean = json!({"formula": {"cut_off_s": 300, "time": "measured"}, "session": at.rsplit('/').next()});
    let tried = ok(rater.post(&format!("{FORMULAS}/previews"), clean).await).await;
    assert_close(&tried["score"]["value"], 154.8);
    assert_eq!(rater.read(FORMULAS).await["items"].as_array().unwrap().len(), 1, "nothing was stored");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_without_a_promised_duration_has_a_reason_and_no_score() {
    let Prepared { centre, planter, at, .. } = prepared().await;
    let rater = &centre.instructor;
    rate(rater, &at, 0, Some(0.0)).await;
    assert_close(&score(rater, &at).await["score"]["points"], 154.8);
    let aside = rater.make(&format!("{at}/edits"), json!({"kind": "set_aside", "why": "Interrupted."})).await;
    assert_eq!(score(rater, &at).await["none"]["reason"], "set_aside");
    ok(rater.post(&format!("{at}/edits/{}/undo", aside["id"].as_str().unwrap()), json!({})).await).await;
    // One that still waits, and one that the quality gate refused. Sheets can be filled in all the same.
    let waiting = session(rater, "ada", recording(100, 1)).await;
    let waiting = format!("/api/v1/sessions/{}", waiting["id"].as_str().unwrap());
    rate(rater, &waiting, 0, Some(0.0)).await;
    assert_eq!(score(rater, &waiting).await["none"]["reason"], "not_scored");
    planter.next_kind().await; // the job of that session, which no worker does here
    let bob = planter.trainee("bob").await;
    planter.result(bob, NEW_YEAR_MS, vec![duration(145.2, 0.4)], (PIPELINE_VERSION, "refused")).await;
    let of_bob = centre.other_instructor.read("/api/v1/sessions?trainee=bob").await;
    let of_bob = format!("/api/v1/sessions/{}", of_bob["items"][0]["id"].as_str().unwrap());
    rate(&centre.other_instructor, &of_bob, 0, Some(0.0)).await;
    assert_eq!(score(&centre.other_trainee, &of_bob).await["none"]["reason"], "refused");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_move_keeps_the_sheet_and_it_counts_for_its_own_task_only() {
    let Prepared { centre, planter, at, .. } = prepared().await;
    let groups: Vec<Value> = centre.administrator.read("/api/v1/groups").await["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|group| group["id"].clone())
        .collect();
    centre.administrator.make("/api/v1/tasks", json!({"name": "Knot", "code": "knot", "groups": groups})).await;
    let formula = json!({"cut_off_s": 600, "time": "measured"});
    centre.instructor.make("/api/v1/tasks/knot/score-formulas", formula).await;
    rate(&centre.instructor, &at, 1, Some(0.0)).await;
    let id = at.rsplit('/').next().unwrap();
    planter.move_session(id, "ada", "knot").await;
    let seen = centre.trainee.read(&format!("{at}/error-sheets")).await;
    assert_eq!((&seen["items"][0]["counts"], &seen["items"][0]["task"]), (&json!(false), &json!("Peg transfer")));
    assert_eq!(seen["score"]["none"]["reason"], "no_sheet");
    problem(centre.instructor.post(&format!("{at}/error-sheets"), json!({})).await, 409, "conflict").await;
    centre
        .instructor
        .make("/api/v1/tasks/knot/error-lists", json!({"items": [{"name": "Slips", "kind": "count"}]}))
        .await;
    let fresh = centre.instructor.make(&format!("{at}/error-sheets"), json!({})).await;
    assert_eq!(fresh["items"][0]["item"], "slips");
    ok(centre.instructor.post(&format!("{at}/error-sheet/finish"), json!({})).await).await;
    assert_close(&score(&centre.trainee, &at).await["score"]["value"], 600.0 - 145.2);
    planter.move_session(id, "ada", "peg").await;
    assert_close(&score(&centre.trainee, &at).await["score"]["points"], 144.8);
}

#[tokio::test(flavor = "multi_thread")]
async fn sheets_outlive_their_rater_open_ones_do_not_and_all_are_erased_with_the_trainee() {
    let Prepared { centre, at, .. } = prepared().await;
    let second = colleague(&centre).await;
    rate(&second, &at, 1, Some(0.0)).await;
    second.make(&format!("{at}/error-sheets"), json!({})).await;
    let people = centre.administrator.read("/api/v1/people").await;
    let iris =
        people["items"].as_array().unwrap().iter().find(|person| person["login"] == "iris").unwrap()["id"].clone();
    let gone = centre.administrator.delete(&format!("/api/v1/people/{}", iris.as_str().unwrap())).await;
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    let seen = centre.trainee.read(&format!("{at}/error-sheets")).await;
    assert_eq!((seen["items"].as_array().unwrap().len(), &seen["items"][0]["who"]), (1, &Value::Null));
    assert_close(&seen["score"]["score"]["points"], 144.8);
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    problem(centre.instructor.get(&format!("{at}/error-sheets")).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn agreement_is_of_blind_sheets_of_people_in_the_callers_scope() {
    let Prepared { centre, planter, .. } = prepared().await;
    let second = colleague(&centre).await;
    let groups = centre.administrator.read("/api/v1/groups").await;
    let one = groups["items"].as_array().unwrap().iter().find(|group| group["name"] == "One").unwrap()["id"].clone();
    let agreement = async |by: &Client| by.read("/api/v1/tasks/peg/error-agreement").await;
    let empty = agreement(&centre.instructor).await;
    assert_eq!(empty["items"][0]["withheld"]["reason"], "too_few", "{empty}");
    for (number, drops) in [[0, 0], [1, 2], [2, 2], [0, 1], [3, 3], [1, 1]].iter().enumerate() {
        let code = format!("t{number}");
        centre.administrator.make("/api/v1/trainees", json!({"name": code, "code": code, "group": one})).await;
        let trainee = planter.trainee(&code).await;
        planter.session(trainee, NEW_YEAR_MS + (number as i64 + 1) * DAY_MS, vec![duration(100.0, 1.0)]).await;
        let sessions = centre.instructor.read(&format!("/api/v1/sessions?trainee={code}")).await;
        let at = format!("/api/v1/sessions/{}", sessions["items"][0]["id"].as_str().unwrap());
        rate(&centre.instructor, &at, drops[0], Some(1.0)).await;
        rate(&second, &at, drops[1], None).await;
    }
    let seen = agreement(&centre.instructor).await;
    let [drops, deviation, knot] = [0, 1, 2].map(|row| &seen["items"][row]);
    assert_eq!((&seen["sessions"], &drops["people"], &drops["raters"]), (&json!(6), &json!(6), &json!(2)));
    assert!(
        drops["single"]["value"].as_f64().unwrap() > 0.6 && drops["single"]["high"].as_f64().unwrap() < 1.0,
        "{drops}"
    );
    assert_close(&drops["same"]["value"], 4.0 / 6.0);
    assert_eq!(deviation["withheld"]["reason"], "too_few", "amounts of one rater alone: {deviation}");
    assert_close(&knot["same"]["value"], 1.0);
    assert_eq!(agreement(&centre.other_instructor).await["sessions"], 0);
}
