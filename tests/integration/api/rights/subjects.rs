//! The centre of the matrix: its callers, and the things that they ask for.

use std::collections::HashMap;
use std::sync::Arc;

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};
use trocar::domain::scope::Scope;
use trocar::domain::single_sign_on::{GroupRoles, ProvenIdentity};
use trocar::settings::DATABASE_FILE;
use trocar::store::{Store, StoreSettings};
use trocar::time::SystemClock;

use super::{MISSING, ROLES};
use crate::api::centre::{Centre, PASSWORD, recording};
use crate::api::tus;
use crate::planted::{plant_owner, plant_palette};
use crate::support::{ADMINISTRATOR, Client, Service, read};

/// A caller, signed in or not.
pub struct Caller {
    pub name: String,
    /// Index in [`ROLES`]; `None` for a caller who is not signed in.
    pub role: Option<usize>,
    pub client: Client,
    pub is_by_token: bool,
    /// The account and its password; `None` for agents and strangers.
    account: Option<(&'static str, &'static str)>,
}

/// The id of something, and the id of its part if the address names one.
#[derive(Clone)]
pub struct Subject {
    pub id: String,
    pub part: String,
}

impl Subject {
    fn of(id: impl Into<String>) -> Self {
        Self { id: id.into(), part: String::new() }
    }

    /// Something that does not exist.
    pub fn missing() -> Self {
        Self { id: MISSING.to_owned(), part: MISSING.to_owned() }
    }
}

/// A centre where one of everything belongs to group one, and another one to group two.
pub struct FilledCentre {
    centre: Centre,
    pub callers: Vec<Caller>,
    /// Groups one and two.
    groups: [Value; 2],
    /// A scored session of Ada, and one of Bob.
    scored: [String; 2],
    /// A course plan.
    pub course: String,
    rescoring: String,
    known: HashMap<(String, usize), Subject>,
    made: u64,
}

impl FilledCentre {
    pub async fn open() -> Self {
        let centre = Centre::open_in(
            Service::start_with(|settings| {
                settings.workers = 1;
                settings.store.senders.uploads = 200; // the administrator makes all of them
            })
            .await,
        )
        .await;
        let administrator = &centre.administrator;
        let listed = administrator.read("/api/v1/groups").await["items"].clone();
        let groups = [listed[0].clone(), listed[1].clone()];
        let mut instructors = groups[0]["instructors"].as_array().unwrap().clone();
        instructors.push(administrator.read("/api/v1/me").await["id"].clone()); // for their token as an instructor
        let members = json!({"instructors": instructors, "trainees": groups[0]["trainees"]});
        administrator.put(&format!("/api/v1/groups/{}/members", text(&groups[0]["id"])), members).await;
        let camera = json!({"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240});
        for (group, number) in groups.iter().zip(["one", "two"]) {
            let (of_box, task) = (format!("box-{number}"), format!("task-{number}"));
            let owned = |code: &str| json!({"name": code, "code": code, "groups": [group["id"]]});
            administrator.make("/api/v1/boxes", owned(&of_box)).await;
            administrator.put(&format!("/api/v1/boxes/{of_box}/camera"), camera.clone()).await;
            administrator.make("/api/v1/tasks", owned(&task)).await;
        }
        let scored = [import(administrator, "ada", 0).await, import(administrator, "bob", 1).await];
        let order = json!({"from": "trajectory", "which": "all"});
        let rescoring = administrator.make("/api/v1/tasks/task-one/rescorings", order).await;
        let plan = json!({"name": "Basics", "steps": [{"task": "task-one", "sessions": 1}]});
        let course = administrator.make("/api/v1/courses", plan).await;
        let (course, rescoring) = (text(&course["id"]), text(&rescoring["id"]));
        let callers = callers(&centre).await;
        let mut known = HashMap::new();
        // The agent's own box, and the trainee's own record.
        for (kind, noun, codes) in [("box", "boxes", ["box-one", "box-two"]), ("trainee", "trainees", ["ada", "bob"])] {
            for (side, code) in codes.into_iter().enumerate() {
                let found = administrator.read(&format!("/api/v1/{noun}/{code}")).await;
                known.insert((kind.to_owned(), side), Subject::of(text(&found["id"])));
            }
        }
        Self { centre, callers, groups, scored, course, rescoring, known, made: 0 }
    }

    pub async fn routes(&self) -> Value {
        self.centre.administrator.read("/api/v1/openapi.json").await
    }

    /// A number that was not used before.
    pub fn unique(&mut self) -> u64 {
        self.made += 1;
        self.made
    }

    /// Something of this kind: of the caller (0) or of another group (1). With `new`, it is made for this request.
    pub async fn subject(&mut self, kind: &str, side: usize, caller: usize, new: bool) -> Subject {
        let is_new = new || matches!(kind, "comment" | "dismissal" | "sign-in" | "identity" | "followed" | "pending");
        let key = (kind.to_owned(), side);
        if !is_new && let Some(found) = self.known.get(&key) {
            return found.clone();
        }
        let made = self.make(kind, side, caller).await;
        if !is_new {
            self.known.insert(key, made.clone());
        }
        made
    }

    async fn make(&mut self, kind: &str, side: usize, caller: usize) -> Subject {
        let number = self.unique();
        let group = &self.groups[side]["id"];
        let owned = |name: &str| json!({"name": format!("{name} {number}"), "groups": [group]});
        let named = |name: &str| json!({"name": format!("{name} {number}")});
        let agent = || json!({"name": "An agent", "role": "agent", "box": "box-two"});
        let (noun, body) = match kind {
            "box" => ("boxes", owned("Box")),
            "task" => ("tasks", owned("Task")),
            "course" => {
                let steps = json!([{"task": "task-one", "sessions": 1}]);
                ("courses", json!({"name": format!("Plan {number}"), "steps": steps, "groups": [group]}))
            }
            "trainee" => ("trainees", json!({"name": format!("Trainee {number}"), "group": group})),
            "spare-group" => ("groups", named("Group")),
            "cohort" => ("cohorts", named("Cohort")),
            "person" => {
                let login = format!("person-{number}");
                ("people", json!({"login": login, "name": login, "role": "instructor", "password": PASSWORD}))
            }
            "own-token" if side == 0 => ("tokens", json!({"name": "A program", "role": "administrator"})),
            "own-token" | "token" => ("tokens", agent()),
            "pending" => {
                let administrator = &self.centre.administrator;
                let id = text(
                    &administrator
                        .make("/api/v1/trainees", json!({"name": format!("Leaving {number}"), "group": group}))
                        .await["id"],
                );
                let path = format!("/api/v1/trainees/{id}?can_be_taken_back=true");
                assert_eq!(administrator.delete(&path).await.status(), StatusCode::NO_CONTENT);
                return Subject::of(id);
            }
            "link" => {
                let login = format!("invited-{number}");
                let account = json!({"login": login, "name": login, "role": "instructor"});
                let person = self.centre.administrator.make("/api/v1/people", account).await;
                ("password-links", json!({"person": person["id"]}))
            }
            "merge" => return self.merge("trainees", "trainee", [owned("Kept"), owned("Merged")]).await,
            "box-merge" => return self.merge("boxes", "box", [owned("Kept box"), owned("Merged box")]).await,
            "calibration" => return self.calibration(owned("Box")).await,
            "palette" => return self.palette(owned("Box")).await,
            "group" => return Subject::of(text(group)),
            "shared" => return Subject::of(self.shared_trainee(number).await),
            "sign-in" => return Subject::of(self.sign_in(side, caller).await),
            "identity" => return Subject::of(self.identity(side, caller, number).await),
            "rescoring" => return Subject::of(&self.rescoring),
            "followed" => {
                let path = format!("/api/v1/groups/{}/course", text(group));
                let following = json!({"course": self.course, "begins": "2026-01-05"});
                read(self.centre.administrator.put(&path, following).await, StatusCode::OK).await;
                return Subject::of(text(group));
            }
            "certificate" => return Subject::of(self.certificate(side).await),
            "exam" => return Subject::of(self.exam(side).await),
            _ => return self.make_of_session(kind, side, caller, number).await,
        };
        Subject::of(text(&self.centre.administrator.make(&format!("/api/v1/{noun}"), body).await["id"]))
    }

    /// An exam of Ada, or of Bob.
    async fn exam(&self, side: usize) -> String {
        let administrator = &self.centre.administrator;
        self.set_standard().await;
        let trainee = ["ada", "bob"][side];
        let new = json!({"trainee": trainee, "task": "task-one", "box": "box-one", "attempts": 1});
        text(&administrator.make("/api/v1/exams", new).await["id"])
    }

    async fn set_standard(&self) {
        let by = json!({"method": "fixed", "limit": 500.0, "unit": "s"});
        let standard =
            json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 1}, "valid_from": "beginning"});
        self.centre.administrator.make("/api/v1/tasks/task-one/standards", standard).await;
    }

    /// The certificate of Ada, or of Bob.
    async fn certificate(&self, side: usize) -> String {
        let administrator = &self.centre.administrator;
        self.set_standard().await;
        import(administrator, ["ada", "bob"][side], 100 + side as u32).await;
        let path = format!("/api/v1/trainees/{}/certificates", ["ada", "bob"][side]);
        text(
            &administrator
                .make(&path, json!({"task": "task-one", "language": "de", "accept_local_address": true}))
                .await["id"],
        )
    }

    /// Two new records that are merged, and their merge.
    async fn merge(&self, noun: &str, field: &str, new: [Value; 2]) -> Subject {
        let administrator = &self.centre.administrator;
        let mut ids = Vec::new();
        for mut record in new {
            if noun == "trainees" {
                let groups = record.as_object_mut().unwrap().remove("groups").unwrap();
                record["group"] = groups[0].clone();
            }
            ids.push(text(&administrator.make(&format!("/api/v1/{noun}"), record).await["id"]));
        }
        let body = json!({field: ids[1], "why": "Registered twice."});
        let made = administrator.make(&format!("/api/v1/{noun}/{}/merges", ids[0]), body).await;
        Subject { id: ids[0].clone(), part: text(&made["id"]) }
    }

    /// A new box, and the version of its camera.
    async fn calibration(&self, new_box: Value) -> Subject {
        let administrator = &self.centre.administrator;
        let id = text(&administrator.make("/api/v1/boxes", new_box).await["id"]);
        let camera = json!({"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240});
        let put = administrator.put(&format!("/api/v1/boxes/{id}/camera"), camera).await;
        Subject { id, part: text(&read(put, StatusCode::OK).await["id"]) }
    }

    /// A new box, and the version of its colours.
    async fn palette(&self, new_box: Value) -> Subject {
        let id = text(&self.centre.administrator.make("/api/v1/boxes", new_box).await["id"]);
        let part = plant_palette(&self.centre.service.data.path().join("trocar.db"), &id, 1, 0).await;
        Subject { id, part }
    }

    /// A session, or something that belongs to one.
    async fn make_of_session(&self, kind: &str, side: usize, caller: usize, number: u64) -> Subject {
        let (administrator, trainee, scored) = (&self.centre.administrator, ["ada", "bob"][side], &self.scored[side]);
        let part = async |by: &Client, noun: &str, body: Value| {
            let made = by.make(&format!("/api/v1/sessions/{scored}/{noun}"), body).await;
            Subject { id: scored.clone(), part: text(&made["id"]) }
        };
        match kind {
            "scored" => Subject::of(scored),
            "recording" => {
                let sent = send_to_one(administrator, trainee, number).await;
                Subject::of(text(&read(sent, StatusCode::CREATED).await["id"]))
            }
            "waiting" => self.waiting(trainee, number).await,
            "upload" => {
                let answer = tus::create(administrator, 5, &upload_of(trainee)).await;
                assert_eq!(answer.status(), StatusCode::CREATED);
                let address = answer.headers()[header::LOCATION].to_str().unwrap();
                Subject::of(address.rsplit('/').next().unwrap())
            }
            "job" => {
                let jobs = administrator.read("/api/v1/jobs?limit=200").await;
                let is_of_session = |job: &&Value| job["session"] == scored.as_str();
                Subject::of(text(&jobs["items"].as_array().unwrap().iter().find(is_of_session).unwrap()["id"]))
            }
            "cut" => part(administrator, "cuts", json!({"at_s": 6, "why": "Two attempts."})).await,
            "edit" => {
                let trim = json!({"kind": "trim", "from_s": 1, "to_s": 9, "why": "Talked at first."});
                part(administrator, "edits", trim).await
            }
            "comment" => {
                let by = match self.callers[caller].account {
                    Some(_) if side == 0 => &self.callers[caller].client,
                    Some(_) => &self.centre.other_instructor,
                    None => administrator,
                };
                part(by, "comments", json!({"from_s": 1, "text": "Here."})).await
            }
            "dismissal" => {
                let session = administrator.read(&format!("/api/v1/sessions/{scored}")).await;
                let by = match self.callers[caller].role {
                    Some(2) if side == 0 => &self.callers[caller].client,
                    Some(3) if side == 1 => &self.centre.other_instructor,
                    Some(3) => &self.callers[caller].client,
                    _ if side == 0 => &self.centre.instructor,
                    _ => &self.centre.other_instructor,
                };
                let (trainee, task) = (&session["trainee"]["id"], &session["task"]["id"]);
                let dismissal = json!({"kind": "refused", "trainee": trainee, "task": task, "sessions": [scored]});
                Subject::of(text(&by.make("/api/v1/attention/dismissals", dismissal).await["id"]))
            }
            "trainee-comment" => {
                let by = if side == 0 { &self.centre.trainee } else { &self.centre.other_trainee };
                part(by, "comments", json!({"from_s": 1, "text": "Here."})).await
            }
            _ => panic!("`{kind}` is no kind of subject"),
        }
    }

    /// A recording that waits for a name, and that the list of a watched folder gives to this trainee.
    async fn waiting(&self, trainee: &str, number: u64) -> Subject {
        let path = format!("/api/v1/waiting-recordings?filename={number}.mp4");
        let clip = self.centre.administrator.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4");
        let sent = clip.body(recording(100, 2_000_000 + number)).send().await.unwrap();
        let id = text(&read(sent, StatusCode::CREATED).await["id"]);
        let trainee = self.centre.administrator.read(&format!("/api/v1/trainees/{trainee}")).await;
        plant_owner(&self.centre.service.data.path().join(DATABASE_FILE), &id, &text(&trainee["id"])).await;
        Subject::of(id)
    }

    /// A new trainee in both groups.
    async fn shared_trainee(&self, number: u64) -> String {
        let administrator = &self.centre.administrator;
        let made = administrator.make("/api/v1/trainees", json!({"name": format!("Shared {number}")})).await;
        for group in &self.groups {
            let address = format!("/api/v1/groups/{}", text(&group["id"]));
            let present = administrator.read(&address).await;
            let mut trainees = present["trainees"].as_array().unwrap().clone();
            trainees.push(made["id"].clone());
            let members = json!({"instructors": present["instructors"], "trainees": trainees});
            read(administrator.put(&format!("{address}/members"), members).await, StatusCode::OK).await;
        }
        text(&made["id"])
    }

    /// A new account at a provider, linked to the caller or to Bob.
    async fn identity(&self, side: usize, caller: usize, number: u64) -> String {
        let login = match self.callers[caller].account {
            Some((login, _)) if side == 0 => login,
            _ => "bob",
        };
        let people = self.centre.administrator.read("/api/v1/people").await;
        let person = people["items"].as_array().unwrap().iter().find(|one| one["login"] == login).unwrap();
        let database = self.centre.service.data.path().join(DATABASE_FILE);
        let store = Store::open(&database, &StoreSettings::default(), Arc::new(SystemClock)).await.unwrap();
        let claims = serde_json::Map::new();
        let (issuer, roles) = (format!("https://{number}.example"), GroupRoles::default());
        let proven = ProvenIdentity::from_claims(issuer, "7".to_owned(), &claims, ("groups", &roles));
        let scope = Scope::instructor(text(&person["id"]).parse().unwrap());
        store.identities().link(&scope, proven).await.unwrap().id.to_string()
    }

    /// A new sign-in of the caller, or of Bob.
    async fn sign_in(&self, side: usize, caller: usize) -> String {
        let (login, password) = match self.callers[caller].account {
            Some(account) if side == 0 => account,
            _ => ("bob", PASSWORD),
        };
        let browser = self.centre.service.sign_in(login, password).await;
        let listed = browser.read("/api/v1/me/sign-ins").await;
        let current = listed["items"].as_array().unwrap().iter().find(|entry| entry["is_current"] == true).unwrap();
        text(&current["id"])
    }
}

/// Strangers, the agent of box one, and each role by cookie and by token. Only administrators have tokens of people.
async fn callers(centre: &Centre) -> Vec<Caller> {
    let stranger =
        |name: &str, client| Caller { name: name.to_owned(), role: None, client, is_by_token: false, account: None };
    let mut callers = vec![
        stranger("stranger", centre.service.stranger()),
        stranger("wrong token", centre.service.stranger().with_token("trc_AAAA")),
    ];
    let accounts = [("ada", PASSWORD), ("ines", PASSWORD), ADMINISTRATOR];
    let cookies = [&centre.trainee, &centre.instructor, &centre.administrator];
    for (role, name) in ROLES.iter().enumerate() {
        if role > 0 {
            let (account, client) = (Some(accounts[role - 1]), cookies[role - 1].clone());
            callers.push(Caller { name: (*name).to_owned(), role: Some(role), client, is_by_token: false, account });
        }
        if *name == "trainee" {
            continue; // administrators make tokens for agents and themselves
        }
        let mut token = json!({"name": name, "role": name});
        if role == 0 {
            token["box"] = json!("box-one");
        }
        let token = text(&centre.administrator.make("/api/v1/tokens", token).await["token"]);
        let client = centre.service.stranger().with_token(&token);
        let account = (role > 0).then_some(ADMINISTRATOR);
        callers.push(Caller { name: format!("{name} by token"), role: Some(role), client, is_by_token: true, account });
    }
    callers
}

/// Imports ten seconds of a path and waits until they are scored.
async fn import(by: &Client, trainee: &str, number: u32) -> String {
    let mut table = "frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm\n".to_owned();
    for frame in 0..250 {
        let time = f64::from(frame) * 0.04;
        let at = time.clamp(1.0, 9.0); // at rest for the first and the last second
        let (x, y) = (40.0 * (at * 1.3).sin(), 20.0 * (at * 0.7).cos() + f64::from(number));
        table += &format!("{frame},{time},left,{x},{y},150,0.1,0.4\n");
    }
    let path = format!("/api/v1/sessions/import?trainee={trainee}&task=task-one&box=box-one");
    let sent = by.request(Method::POST, &path).header(header::CONTENT_TYPE, "text/csv").body(table);
    let id = text(&read(sent.send().await.unwrap(), StatusCode::CREATED).await["id"]);
    by.read_until(&format!("/api/v1/sessions/{id}"), |session| session["status"] == "done").await;
    id
}

/// Sends a recording that waits for the colours of box one.
async fn send_to_one(by: &Client, trainee: &str, number: u64) -> reqwest::Response {
    let path = format!("/api/v1/sessions?trainee={trainee}&task=task-one&box=box-one&filename=clip.mp4");
    let clip = by.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4").body(recording(100, number));
    clip.send().await.unwrap()
}

/// The metadata of an upload of this trainee.
pub fn upload_of(trainee: &str) -> String {
    tus::metadata(&[("filename", "clip.mp4"), ("trainee", trainee), ("task", "task-one"), ("box", "box-one")])
}

fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}
