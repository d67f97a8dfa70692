//! Standards, cohorts and progress, as a client sees them.

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, measured};
use crate::support::{Client, problem, read};
use trocar::domain::session::FeatureSpace;

const STANDARDS: &str = "/api/v1/tasks/peg/standards";
const PROPOSALS: &str = "/api/v1/tasks/peg/standards/proposals";
const ADA: &str = "/api/v1/trainees/ada/progress?task=peg";

async fn planter(centre: &Centre) -> Planter {
    Planter::open(&centre.service.data.path().join("trocar.db")).await
}

/// Adds `count` people of a level with one session each. The first takes `seconds`, each further one a second more.
async fn add_people(centre: &Centre, planter: &Planter, level: &str, count: usize, seconds: f64) {
    for number in 0..count {
        let name = format!("{level}-{number}");
        let hand = if number % 2 == 0 { "right" } else { "left" };
        let body = json!({"name": name, "level": level, "handedness": hand});
        centre.administrator.make("/api/v1/trainees", body).await;
        let path = measured("path_length", "mm", Some("orange"), FeatureSpace::Space3d, 900.0 + number as f64, 20.0);
        let rows = vec![duration(seconds + number as f64, 1.0), path];
        planter.session(planter.trainee(&name).await, NEW_YEAR_MS, rows).await;
    }
}

/// Adds one session of Ada per day, from New Year on.
async fn practise(planter: &Planter, seconds: impl IntoIterator<Item = f64>) {
    let ada = planter.trainee("ada").await;
    for (day, seconds) in seconds.into_iter().enumerate() {
        planter.session(ada, NEW_YEAR_MS + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
}

fn fixed(limit: f64) -> Value {
    json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": limit, "unit": "s"}}]})
}

async fn cohort(administrator: &Client, level: &str) {
    administrator.make("/api/v1/cohorts", json!({"name": level, "level": level})).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn limits_are_made_from_people_and_say_from_how_many() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    add_people(&centre, &planter, "expert", 12, 40.0).await;
    add_people(&centre, &planter, "novice", 12, 90.0).await;
    cohort(&centre.administrator, "expert").await;
    cohort(&centre.administrator, "novice").await;
    let propose = async |by: Value| {
        let answer =
            centre.administrator.post(PROPOSALS, json!({"targets": [{"feature": "duration", "by": by}]})).await;
        read(answer, StatusCode::OK).await["targets"][0].clone()
    };
    let experts = propose(json!({"method": "trimmed_experts", "experts": "expert"})).await["target"].clone();
    assert_eq!(experts["basis"], json!({"method": "trimmed_experts", "experts": 12, "dropped": 0}));
    assert_eq!((&experts["limit"], &experts["unit"], &experts["better"]), (&json!(45.5), &json!("s"), &json!("lower")));
    assert_eq!(experts["made_from"]["fingerprint"].as_str().unwrap().len(), 64);
    let groups = json!({"method": "contrasting_groups", "novices": "novice", "experts": "expert"});
    let groups = propose(groups).await["target"].clone();
    let limit = groups["limit"].as_f64().unwrap();
    assert!((52.0..90.0).contains(&limit), "{groups}");
    for wrong in ["false_pass", "false_fail"] {
        let share = &groups["basis"][wrong];
        assert!(share["seen"] == 0.0 && share["high"].as_f64().unwrap() > 0.1, "{groups}");
    }
    let best = json!({"method": "best_share", "cohort": "novice", "share": 0.5});
    let by_instructor = json!({"targets": [{"feature": "duration", "by": best}]});
    problem(centre.instructor.post(PROPOSALS, by_instructor).await, 403, "forbidden").await;
    let limit = propose(best).await["target"]["limit"].as_f64().unwrap();
    assert!((limit - 95.5).abs() < 1e-6, "{limit}");

    // The same person in both groups, or too few people, give a reason instead of a limit.
    let same = json!({"method": "contrasting_groups", "novices": "expert", "experts": "expert"});
    let refused = propose(same).await;
    assert_eq!((&refused["target"], &refused["withheld"]["reason"]), (&Value::Null, &json!("person_twice")));
    let nine: Vec<Value> =
        centre.administrator.read("/api/v1/cohorts/novice/members").await["items"].as_array().unwrap()[..9].into();
    centre.administrator.make("/api/v1/cohorts", json!({"name": "Nine", "members": nine})).await;
    let few = json!({"method": "contrasting_groups", "novices": "nine", "experts": "expert"});
    let refused = propose(few.clone()).await;
    assert_eq!((&refused["withheld"]["reason"], &refused["withheld"]["missing"]), (&json!("too_few"), &json!(1)));
    let set = json!({"targets": [{"feature": "duration", "by": few}]});
    let refused = problem(centre.administrator.post(STANDARDS, set).await, 422, "invalid").await;
    assert!(refused["detail"].as_str().unwrap().contains("needs 10 novices; there are 9"), "{refused}");

    // The fingerprint could reveal the people behind the values, so only administrators get it with the target.
    let by = json!({"method": "trimmed_experts", "experts": "expert"});
    let set = json!({"targets": [{"feature": "duration", "by": by}]});
    read(centre.administrator.post(STANDARDS, set).await, StatusCode::CREATED).await;
    practise(&planter, [60.0, 50.0]).await;
    let group = centre.instructor.read("/api/v1/groups").await["items"][0]["id"].as_str().unwrap().to_owned();
    let mut shown = vec![centre.instructor.read(&format!("/api/v1/groups/{group}/progress?task=peg")).await];
    for by in [&centre.instructor, &centre.trainee] {
        shown.push(by.read("/api/v1/trainees/ada/progress?task=peg").await);
    }
    for answer in shown {
        let text = answer.to_string();
        assert!(text.contains("\"made_from\":{") && text.contains("\"fingerprint\":null"), "{text}");
        assert!(!text.contains(experts["made_from"]["fingerprint"].as_str().unwrap()), "{text}");
    }

    // A tool's limit uses people who prefer the same hand.
    let of_tool = |cohort: &str| {
        let by = json!({"method": "best_share", "cohort": cohort, "share": 0.5});
        json!({"targets": [{"feature": "path_length", "tool": "orange", "by": by}]})
    };
    problem(centre.administrator.post(PROPOSALS, of_tool("novice")).await, 422, "invalid").await;
    centre.administrator.make("/api/v1/cohorts", json!({"name": "Right", "handedness": "right"})).await;
    let proposal = read(centre.administrator.post(PROPOSALS, of_tool("right")).await, StatusCode::OK).await;
    let target = &proposal["targets"][0]["target"];
    assert_eq!(
        (&target["basis"]["people"], &target["made_from"]["handedness"]),
        (&json!(12), &json!("right")),
        "{proposal}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_invalid_standard_is_refused_with_the_reason() {
    let centre = Centre::open().await;
    let by = |by: Value| json!({"targets": [{"feature": "duration", "by": by}]});
    let length = json!({"method": "fixed", "limit": 100, "unit": "mm"});
    let with = |key: &str, value: Value| {
        let mut body = fixed(48.0);
        body[key] = value;
        body
    };
    for (body, why) in [
        (json!({"targets": []}), "expected 1 to 20"),
        (json!({"targets": [{"feature": "wizardry", "by": {"method": "fixed", "limit": 1, "unit": "s"}}]}), "wizardry"),
        (
            json!({"targets": [{"feature": "mean_velocity", "by": {"method": "fixed", "limit": 1, "unit": "mm/s"}}]}),
            "neither",
        ),
        (
            json!({"targets": [{"feature": "duration", "space": "image", "by": {"method": "fixed", "limit": 1, "unit": "s"}}]}),
            "not measured",
        ),
        (by(json!({"method": "fixed", "limit": 48, "unit": "min"})), "measured in `s`"),
        (by(json!({"method": "fixed", "limit": -1, "unit": "s"})), "lies between"),
        (by(json!({"method": "fixed", "limit": "NaN", "unit": "s"})), "NaN"),
        (by(json!({"method": "fls", "preset": "juggling"})), "peg_transfer"),
        (by(json!({"method": "best_share", "cohort": "missing", "share": 1.5})), "share"),
        (json!({"targets": [fixed(1.0)["targets"][0], fixed(2.0)["targets"][0]]}), "twice"),
        (with("rule", json!({"in_a_row": 0})), "in_a_row"),
        (with("charts", json!({"adequate": 0.5})), "chances"),
        (with("surprise", json!(1)), "surprise"),
        (with("valid_from", json!("someday")), "2026-01-05"),
        (json!({"targets": [{"feature": "path_length", "tool": "red", "in_hand": "left", "by": length}]}), "left out"),
        (json!({"targets": [{"feature": "synchrony", "in_hand": "left", "by": length}]}), "whole session"),
        (json!({"targets": [{"feature": "path_length", "in_hand": "third", "by": length}]}), "dominant"),
    ] {
        let refused = problem(centre.instructor.post(STANDARDS, body.clone()).await, 422, "invalid").await;
        assert!(refused["detail"].as_str().unwrap().contains(why), "{body}: {refused}");
    }
    let nan = r#"{"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": NaN, "unit": "s"}}]}"#;
    let sent = centre.instructor.request(Method::POST, STANDARDS).header("content-type", "application/json").body(nan);
    problem(sent.send().await.unwrap(), 400, "bad-request").await;
    let unknown_cohort = by(json!({"method": "trimmed_experts", "experts": "missing"}));
    problem(centre.administrator.post(STANDARDS, unknown_cohort).await, 422, "unknown-reference").await;
    problem(centre.instructor.post("/api/v1/tasks/knots/standards", fixed(1.0)).await, 404, "not-found").await;
    assert!(
        centre.trainee.read(STANDARDS).await["items"].as_array().unwrap().is_empty(),
        "no refused standard is kept"
    );
    problem(centre.trainee.post(STANDARDS, fixed(48.0)).await, 403, "forbidden").await;
    problem(centre.trainee.post(PROPOSALS, fixed(48.0)).await, 403, "forbidden").await;
    for path in [STANDARDS, "/api/v1/cohorts", "/api/v1/features", ADA] {
        problem(centre.agent.get(path).await, 403, "forbidden").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_published_standard_is_stored_and_the_same_one_again_makes_no_new_version() {
    let centre = Centre::open().await;
    let presets = centre.trainee.read("/api/v1/tasks/peg/standards/presets").await;
    let peg = &presets["items"][0];
    assert_eq!(
        (&peg["preset"], &peg["limit"], &peg["rule"]["then_more"]),
        (&json!("peg_transfer"), &json!(48.0), &json!(10))
    );
    let by = json!({"method": "fls", "preset": "peg_transfer"});
    let body = json!({"targets": [{"feature": "duration", "by": by}], "rule": peg["rule"]});
    let first = centre.instructor.make(STANDARDS, body.clone()).await;
    assert_eq!(first["targets"][0]["basis"]["method"], "external", "the basis says that it was not measured here");
    let again = centre.instructor.make(STANDARDS, body).await;
    assert_eq!((&again["id"], &again["version"]), (&first["id"], &json!(1)));
    assert_eq!(centre.instructor.make(STANDARDS, fixed(60.0)).await["version"], 2);
    let listed = centre.trainee.read(STANDARDS).await;
    let shown: Vec<&Value> = listed["items"].as_array().unwrap().iter().map(|s| &s["version"]).collect();
    assert_eq!((shown, &listed["items"][0]["who"]), (vec![&json!(2), &json!(1)], &Value::Null));
    assert_eq!(centre.instructor.read(STANDARDS).await["items"][0]["who"], "ines");
}

#[tokio::test(flavor = "multi_thread")]
async fn progress_judges_sessions_and_follows_rule_curve_charts_and_reminders() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    let learning = (0..40).map(|n| 40.0 + 80.0 * (-f64::from(n) / 4.0).exp() + f64::from(n * 7 % 5) / 2.0);
    practise(&planter, learning).await;
    let mut standard = fixed(50.0);
    standard["rule"] = json!({"in_a_row": 2, "then_more": 10});
    centre.instructor.make(STANDARDS, standard).await;
    let progress = centre.trainee.read(ADA).await;
    let sessions = progress["sessions"].as_array().unwrap();
    assert_eq!(
        (sessions.len(), &sessions[39]["number"], &progress["pipeline"]),
        (40, &json!(40), &json!(trocar::motion::PIPELINE_VERSION))
    );
    let [series] = &progress["features"].as_array().unwrap()[..] else { panic!("{progress}") };
    assert_eq!(
        (&series["feature"], &series["unit"], &series["target"]["limit"]),
        (&json!("duration"), &json!("s"), &json!(50.0))
    );
    let point = |number: usize| &series["points"][number - 1];
    assert_eq!(
        (&point(1)["value"], &point(1)["low"], &point(1)["judgement"]),
        (&json!(120.0), &json!(119.0), &json!("fail"))
    );
    assert_eq!((&point(40)["judgement"], &sessions[39]["trial"]), (&json!("pass"), &json!("passed")));
    let curve = &series["learning"]["curve"];
    assert!((curve["plateau"]["value"].as_f64().unwrap() - 41.0).abs() < 1.0, "{curve}");
    assert!((curve["tau_sessions"]["value"].as_f64().unwrap() - 4.0).abs() < 0.5, "{curve}");
    let line = curve["line"].as_array().unwrap();
    assert_eq!((line.len(), &line[0]["session"], &line[line.len() - 1]["session"]), (32, &json!(1), &json!(40)));
    assert!(
        line.iter().all(|at| at["low"].as_f64() <= at["value"].as_f64() && at["value"].as_f64() <= at["high"].as_f64())
    );
    assert_eq!(series["learning"]["forecast"]["state"], "reached");
    let first_pass = sessions.iter().position(|s| s["trial"] == "passed").unwrap() + 1;
    assert!((8..14).contains(&first_pass), "{first_pass}");
    let met = progress["rule"]["met_at"].as_u64().unwrap() as usize;
    assert!(progress["rule"]["state"] == "met" && met >= first_pass + 11, "{}", progress["rule"]);
    let charts = &progress["charts"];
    assert_eq!(charts["standing"], "proficient", "{charts}");
    assert!(charts["declared_wrongly"].as_f64().unwrap() <= 0.05 && charts["declared_rightly"].as_f64().unwrap() > 0.9);
    assert!((charts["declares_at"].as_f64().unwrap() - 4.150241).abs() < 1e-5, "{charts}");
    let [declared] = &charts["events"].as_array().unwrap()[..] else { panic!("{charts}") };
    assert_eq!(
        declared["session"].as_u64().unwrap() as usize,
        first_pass + 16,
        "17 passes in a row declare proficiency"
    );
    let due: Vec<&Value> = progress["reminders"].as_array().unwrap().iter().map(|r| &r["due_at"]).collect();
    let met_day = |days: i64| trocar::time::to_rfc3339(NEW_YEAR_MS + (met as i64 - 1 + days) * DAY_MS);
    assert_eq!(due, [&json!(met_day(30)), &json!(met_day(91))]);

    // A single session and a list contain the judgement.
    let id = sessions[39]["id"].as_str().unwrap();
    let one = centre.trainee.read(&format!("/api/v1/sessions/{id}")).await["features"][0].clone();
    assert_eq!(
        (&one["judgement"], &one["target"]),
        (&json!("pass"), &json!({"limit": 50.0, "better": "lower", "in_hand": null, "standard": 1}))
    );
    let listed = centre.trainee.read("/api/v1/sessions?task=peg&limit=1").await["items"][0]["features"][0].clone();
    assert!(listed["judgement"].is_string(), "{listed}");
}

#[tokio::test(flavor = "multi_thread")]
async fn too_few_sessions_say_how_many_are_missing_and_excluded_sessions_keep_their_number() {
    let centre = Centre::open().await;
    let empty = centre.trainee.read("/api/v1/trainees/ada/progress").await;
    assert_eq!((&empty["task"], &empty["sessions"], &empty["standard"]), (&Value::Null, &json!([]), &Value::Null));
    let planter = planter(&centre).await;
    practise(&planter, [60.0, 55.0]).await;
    let ada = planter.trainee("ada").await;
    let day = |day: i64| NEW_YEAR_MS + day * DAY_MS;
    let refused =
        trocar::domain::session::FeatureRow { value: Err("refused".to_owned()), error: None, ..duration(1.0, 0.1) };
    planter.result(ada, day(10), vec![refused], (trocar::motion::PIPELINE_VERSION, "refused")).await;
    planter.result(ada, day(11), vec![duration(1.0, 0.1)], ("0", "valid")).await;
    planter.session(ada, day(12), vec![duration(45.0, 1.0)]).await;
    centre.instructor.make(STANDARDS, fixed(48.0)).await;
    cohort(&centre.administrator, "novice").await;
    let progress = centre.trainee.read(&format!("{ADA}&cohort=novice")).await;
    let aside: Vec<&Value> = progress["sessions"].as_array().unwrap().iter().map(|s| &s["set_aside"]).collect();
    assert_eq!(aside, [&Value::Null, &Value::Null, &json!("refused"), &json!("other_version"), &Value::Null]);
    let trials: Vec<&Value> = progress["sessions"].as_array().unwrap().iter().map(|s| &s["trial"]).collect();
    assert_eq!(trials, ["failed", "failed", "unknown", "unknown", "passed"]);
    let series = &progress["features"][0];
    let learning = &series["learning"];
    assert_eq!((&learning["state"], &learning["withheld"]["missing"]), (&json!("withheld"), &json!(3)), "{learning}");
    assert_eq!((&series["place"], &series["no_place"]["missing"]), (&Value::Null, &json!(10)), "{series}");
    assert_eq!((&progress["charts"]["standing"], &progress["rule"]), (&json!("not_yet"), &Value::Null));
    assert_eq!(progress["reminders"], json!([]));
    for (query, status, slug) in [
        ("&feature=wizardry", 422, "invalid"),
        ("&feature=duration&space=image", 422, "invalid"),
        ("&feature=duration&space=4d", 400, "bad-request"),
        ("&cohort=missing", 422, "unknown-reference"),
        ("&surprise=1", 400, "bad-request"),
    ] {
        problem(centre.trainee.get(&format!("{ADA}{query}")).await, status, slug).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn people_are_ranked_among_ten_others_and_left_handers_tools_among_left_handers() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    add_people(&centre, &planter, "novice", 20, 50.0).await;
    cohort(&centre.administrator, "novice").await;
    let left = json!({"handedness": "left", "level": "novice"});
    read(centre.administrator.patch("/api/v1/trainees/ada", left).await, StatusCode::OK).await;
    let path = measured("path_length", "mm", Some("orange"), FeatureSpace::Space3d, 905.0, 1.0);
    planter.session(planter.trainee("ada").await, NEW_YEAR_MS, vec![duration(54.5, 0.1), path]).await;
    let place = async |client: &Client, query: &str| {
        let progress = client.read(&format!("{ADA}&cohort=novice&{query}")).await;
        let mut tools = progress["features"].as_array().unwrap().iter();
        tools.find(|series| series["tool"].is_null() || query.contains("path")).unwrap().clone()
    };
    let whole = place(&centre.trainee, "feature=duration").await;
    assert_eq!(
        (&whole["place"]["people"], &whole["place"]["percentile"]["value"]),
        (&json!(20), &json!(25.0)),
        "{whole}"
    );
    assert_eq!(whole["place"]["better_than"]["value"], 75.0);
    assert!(whole["place"]["percentile"]["low"].as_f64().unwrap() < 15.0, "{whole}");
    let tool = place(&centre.trainee, "feature=path_length").await;
    assert_eq!(tool["place"]["people"], 10, "only left-handed people: {tool}");
    let both = json!({"handedness": "both"});
    read(centre.administrator.patch("/api/v1/trainees/ada", both).await, StatusCode::OK).await;
    let tool = place(&centre.instructor, "feature=path_length").await;
    assert_eq!((&tool["place"], &tool["no_place"]["missing"]), (&Value::Null, &json!(10)), "{tool}");

    // The cohort's answer names only people in the caller's scope.
    let answer = centre.instructor.read("/api/v1/cohorts/novice").await;
    let ada = centre.instructor.read("/api/v1/trainees/ada").await["id"].clone();
    assert_eq!(answer["people"], 21);
    let members = centre.instructor.read("/api/v1/cohorts/novice/members").await;
    assert_eq!((&members["items"], &members["next"]), (&json!([ada]), &Value::Null));
    let text = centre.instructor.read(&format!("{ADA}&cohort=novice")).await.to_string();
    assert!(!text.contains("novice-"), "{text}");
    problem(centre.instructor.get("/api/v1/trainees/bob/progress?task=peg&cohort=novice").await, 404, "not-found")
        .await;
    for client in [&centre.instructor, &centre.trainee] {
        problem(client.post("/api/v1/cohorts", json!({"name": "Mine"})).await, 403, "forbidden").await;
        problem(client.delete("/api/v1/cohorts/novice").await, 403, "forbidden").await;
    }
    let mixed = json!({"name": "x", "level": "expert", "members": [ada]});
    problem(centre.administrator.post("/api/v1/cohorts", mixed).await, 422, "invalid").await;
    let put = centre.administrator.put("/api/v1/cohorts/novice", json!({"name": "Just Ada", "members": [ada]})).await;
    assert_eq!(read(put, StatusCode::OK).await["people"], 1);
    assert_eq!(centre.administrator.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    assert_eq!(
        centre.administrator.read("/api/v1/cohorts/novice").await["people"],
        0,
        "the member is erased with the person"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_version_counts_from_its_day_and_a_proposal_says_what_it_would_change() {
    let centre = Centre::open().await;
    let planter = planter(&centre).await;
    centre.instructor.make(STANDARDS, fixed(50.0)).await;
    practise(&planter, [60.0, 40.0]).await;
    let outcome = || async {
        let sessions = centre.trainee.read(ADA).await["sessions"].clone();
        let of = |at: usize| (sessions[at]["trial"].clone(), sessions[at]["standard"].clone());
        [of(0), of(1)]
    };
    let before = outcome().await;
    assert_eq!(before, [(json!("failed"), json!(1)), (json!("passed"), json!(1))]);
    let easier = |from: Value| {
        let mut standard = fixed(100.0);
        standard["valid_from"] = from;
        standard
    };
    let now = read(centre.instructor.post(PROPOSALS, easier(json!("now"))).await, StatusCode::OK).await;
    assert_eq!(now["effect"]["trainees"].as_array().unwrap().iter().filter(|one| one["judged_anew"] != 0).count(), 0);
    let all = read(centre.instructor.post(PROPOSALS, easier(json!("beginning"))).await, StatusCode::OK).await;
    let touched = &all["effect"]["trainees"][0];
    assert_eq!((&touched["judged_anew"], &all["effect"]["valid_from"]), (&json!(1), &Value::Null), "{all}");
    assert_eq!(centre.instructor.read(STANDARDS).await["items"].as_array().unwrap().len(), 1, "nothing is set yet");
    let other = read(centre.other_instructor.post(PROPOSALS, easier(json!("beginning"))).await, StatusCode::OK).await;
    assert_eq!(other["effect"]["trainees"], json!([]), "only trainees that the caller may see");

    centre.instructor.make(STANDARDS, easier(Value::Null)).await;
    assert_eq!(outcome().await, before, "a later version counts from now on if nothing is said");
    centre.instructor.make(STANDARDS, easier(json!("beginning"))).await;
    assert_eq!(outcome().await, [(json!("passed"), json!(3)), (json!("passed"), json!(3))]);
    let versions = centre.trainee.read(STANDARDS).await;
    assert_eq!(
        (&versions["items"][0]["valid_from"], &versions["items"][2]["valid_from"]),
        (&Value::Null, &Value::Null)
    );
    assert!(versions["items"][1]["valid_from"].is_string(), "{versions}");
}
