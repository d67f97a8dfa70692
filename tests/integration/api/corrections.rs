//! The law of corrections: after random moves of sessions, merges of records, cuts of recordings and their reversal,
//! progress, standards and courses equal those of a new centre where all was filed right from the beginning. The ordinary
//! tests take 60 steps, `make corrections` 1,000.

use std::collections::HashMap;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::domain::session::FeatureRow;
use trocar::ids::{CutId, SessionId, TaskId};

use super::centre::{Centre, set_members};
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::process::program;
use crate::support::read;

const PEOPLE: [&str; 5] = ["ada", "bob", "cleo", "dora", "emil"];
const TASKS: [&str; 2] = ["peg", "knots"];
const BOXES: [&str; 2] = ["box-1", "box-2"];
const SESSIONS: usize = 20;
/// Length of a recording, s.
const LENGTH_S: u32 = 64;
/// Most parts of all recordings.
const MAX_PARTS: usize = 30;
/// Who is in the groups One and Two at first.
const MEMBERS: [&[usize]; 2] = [&[0, 2, 3], &[1, 3]];

/// The part of a recording that a session has.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Part {
    recording: usize,
    from_s: u32,
    to_s: u32,
}

impl Part {
    /// When it was recorded, epoch ms.
    fn at_ms(self) -> i64 {
        NEW_YEAR_MS + self.recording as i64 * DAY_MS + i64::from(self.from_s) * 1000
    }

    /// What is measured in it: another value for each part.
    fn measured(self) -> FeatureRow {
        let seconds = (self.recording as u32 * 7 + self.from_s * 3 + self.to_s) % 20;
        duration(30.0 + f64::from(seconds), 1.0)
    }
}

/// Where all is filed, as the corrections say.
#[derive(Clone, PartialEq)]
struct Filed {
    /// What each session shows; `None`: it was joined with another one.
    parts: Vec<Option<Part>>,
    /// Person and task of each session.
    sessions: Vec<(usize, usize)>,
    /// Box of each session.
    boxes: Vec<usize>,
    /// People of each group.
    groups: [Vec<usize>; 2],
}

/// A merge that is in force: of two people or of the two boxes.
#[derive(Clone)]
struct Merge {
    kept: usize,
    merged: usize,
    /// The sessions that followed.
    sessions: Vec<usize>,
    /// The groups that followed.
    groups: Vec<usize>,
}

/// A cut that is in force: the sessions with the part before it and with the part after it.
#[derive(Clone, Copy, Debug)]
struct Cut {
    first: usize,
    second: usize,
}

/// The records, their merges and the cuts, as a plain table.
#[derive(Clone)]
struct Table {
    filed: Filed,
    cuts: Vec<Cut>,
    people: Vec<Merge>,
    boxes: Vec<Merge>,
}

/// One correction.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// A session to a person and a task.
    Move(usize, (usize, usize)),
    /// Two people: kept, merged.
    Merge(usize, usize),
    Separate(usize, usize),
    /// The boxes: kept, merged.
    MergeBoxes(usize, usize),
    SeparateBoxes(usize, usize),
    /// A session, where it is cut, s.
    Cut(usize, u32),
    /// The two parts of a cut.
    Join(usize, usize),
}

impl Table {
    fn new() -> Self {
        let sessions = (0..SESSIONS).map(|number| (number % PEOPLE.len(), number % 3 / 2)).collect();
        let boxes = (0..SESSIONS).map(|number| number % BOXES.len()).collect();
        let part = |recording| Some(Part { recording, from_s: 0, to_s: LENGTH_S });
        let parts = (0..SESSIONS).map(part).collect();
        let filed = Filed { parts, sessions, boxes, groups: MEMBERS.map(<[usize]>::to_vec) };
        Self { filed, cuts: Vec::new(), people: Vec::new(), boxes: Vec::new() }
    }

    /// The sessions that exist.
    fn existing(&self) -> Vec<usize> {
        (0..self.filed.parts.len()).filter(|number| self.filed.parts[*number].is_some()).collect()
    }

    /// Whether the parts of a cut can be joined: they are filed alike, and neither was cut again since.
    fn is_joinable(&self, at: usize) -> bool {
        let Cut { first, second } = self.cuts[at];
        let filed = |number: usize| (self.filed.sessions[number], self.filed.boxes[number]);
        filed(first) == filed(second)
            && self.cuts[at + 1..].iter().all(|later| later.first != first && later.first != second)
    }

    /// The second part is filed as the first one, and follows the merges that the first one has followed.
    fn cut(&mut self, first: usize, at_s: u32) {
        let second = self.filed.parts.len();
        let whole = self.filed.parts[first].unwrap();
        self.filed.parts[first] = Some(Part { to_s: at_s, ..whole });
        self.filed.parts.push(Some(Part { from_s: at_s, ..whole }));
        self.filed.sessions.push(self.filed.sessions[first]);
        self.filed.boxes.push(self.filed.boxes[first]);
        for merge in self.people.iter_mut().chain(&mut self.boxes).filter(|of| of.sessions.contains(&first)) {
            merge.sessions.push(second);
        }
        self.cuts.push(Cut { first, second });
    }

    fn join(&mut self, first: usize, second: usize) {
        let end_s = self.filed.parts[second].take().unwrap().to_s;
        self.filed.parts[first].as_mut().unwrap().to_s = end_s;
        self.people.iter_mut().chain(&mut self.boxes).for_each(|of| of.sessions.retain(|one| *one != second));
        self.cuts.retain(|cut| cut.second != second);
    }

    fn is_shown(&self, person: usize) -> bool {
        self.people.iter().all(|merge| merge.merged != person)
    }

    fn follow(&mut self, merge: &mut Merge) {
        let Merge { kept, merged, .. } = *merge;
        let exists = |number: &usize| self.filed.parts[*number].is_some();
        for (number, at) in self.filed.sessions.iter_mut().enumerate().filter(|(at, of)| of.0 == merged && exists(at)) {
            at.0 = kept;
            merge.sessions.push(number);
        }
        for (number, group) in self.filed.groups.iter_mut().enumerate() {
            if group.contains(&merged) && !group.contains(&kept) {
                group.retain(|one| *one != merged);
                group.push(kept);
                merge.groups.push(number);
            }
        }
    }

    fn unfollow(&mut self, merge: &mut Merge) {
        let Merge { kept, merged, .. } = *merge;
        for number in merge.sessions.drain(..) {
            let at = &mut self.filed.sessions[number];
            at.0 = if at.0 == kept { merged } else { at.0 };
        }
        for number in merge.groups.drain(..) {
            let group = &mut self.filed.groups[number];
            group.retain(|one| *one != kept);
            group.push(merged);
        }
    }

    fn take(&mut self, step: Step) {
        match step {
            Step::Move(number, to) => self.filed.sessions[number] = to,
            Step::Merge(kept, merged) => {
                let mut merge = Merge { kept, merged, sessions: Vec::new(), groups: Vec::new() };
                self.follow(&mut merge);
                self.people.push(merge);
            }
            Step::Separate(kept, merged) => {
                let at = self.people.iter().position(|one| (one.kept, one.merged) == (kept, merged)).unwrap();
                let later: Vec<usize> =
                    (at + 1..self.people.len()).filter(|of| self.people[*of].kept == kept).collect();
                for number in later.iter().rev().chain([&at]) {
                    let mut merge = self.people[*number].clone();
                    self.unfollow(&mut merge);
                    self.people[*number] = merge;
                }
                for number in later {
                    let mut merge = self.people[number].clone();
                    self.follow(&mut merge);
                    self.people[number] = merge;
                }
                self.people.remove(at);
            }
            Step::MergeBoxes(kept, merged) => {
                let sessions =
                    self.existing().into_iter().filter(|number| self.filed.boxes[*number] == merged).collect();
                self.filed.boxes.fill(kept);
                self.boxes.push(Merge { kept, merged, sessions, groups: Vec::new() });
            }
            Step::SeparateBoxes(_, merged) => {
                for number in self.boxes.pop().unwrap().sessions {
                    self.filed.boxes[number] = merged;
                }
            }
            Step::Cut(number, at_s) => self.cut(number, at_s),
            Step::Join(first, second) => self.join(first, second),
        }
    }

    /// The steps back to `first`: all records are separated, the last merge first, all sessions moved back, and all parts
    /// joined, those of the last cut first.
    fn reversal(&self, first: &Filed) -> Vec<Step> {
        let mut end = self.clone();
        let boxes = self.boxes.iter().map(|merge| Step::SeparateBoxes(merge.kept, merge.merged));
        let people = self.people.iter().rev().map(|merge| Step::Separate(merge.kept, merge.merged));
        let mut steps: Vec<Step> = boxes.chain(people).collect();
        steps.iter().for_each(|step| end.take(*step));
        for number in self.existing() {
            let at = first.sessions[self.filed.parts[number].unwrap().recording];
            if end.filed.sessions[number] != at {
                steps.push(Step::Move(number, at));
            }
        }
        steps.extend(self.cuts.iter().rev().map(|cut| Step::Join(cut.first, cut.second)));
        steps
    }

    /// A random step that is possible now.
    fn random_step(&self, random: &mut impl FnMut(usize) -> usize) -> Step {
        loop {
            let (one, other) = (random(PEOPLE.len()), random(PEOPLE.len()));
            let is_new = one != other && self.is_shown(one) && self.is_shown(other);
            let existing = self.existing();
            match random(16) {
                0..7 => {
                    let (number, to) = (existing[random(existing.len())], (one, random(TASKS.len())));
                    if self.is_shown(one) && self.filed.sessions[number] != to {
                        return Step::Move(number, to);
                    }
                }
                7..9 if is_new => return Step::Merge(one, other),
                9..11 if !self.people.is_empty() => {
                    let merge = &self.people[random(self.people.len())];
                    if self.is_shown(merge.kept) {
                        return Step::Separate(merge.kept, merge.merged);
                    }
                }
                11 => {
                    let kept = random(2);
                    return match self.boxes.first() {
                        None => Step::MergeBoxes(kept, 1 - kept),
                        Some(merge) => Step::SeparateBoxes(merge.kept, merge.merged),
                    };
                }
                12..14 if existing.len() < MAX_PARTS => {
                    let number = existing[random(existing.len())];
                    let Part { from_s, to_s, .. } = self.filed.parts[number].unwrap();
                    if to_s - from_s > 2 {
                        return Step::Cut(number, from_s + 1 + random((to_s - from_s - 1) as usize) as u32);
                    }
                }
                14..16 if !self.cuts.is_empty() => {
                    let at = random(self.cuts.len());
                    if self.is_joinable(at) {
                        return Step::Join(self.cuts[at].first, self.cuts[at].second);
                    }
                }
                _ => {}
            }
        }
    }
}

/// A centre with these people, tasks and boxes.
struct World {
    centre: Centre,
    planter: Planter,
    sessions: Vec<SessionId>,
    /// The cuts that were made, by their second session.
    cuts: HashMap<SessionId, CutId>,
}

impl World {
    /// A centre where all is filed like this from the beginning.
    async fn open(filed: &Filed) -> Self {
        let centre = Centre::open().await;
        let administrator = &centre.administrator;
        for code in &PEOPLE[2..] {
            administrator.make("/api/v1/trainees", json!({"name": code, "code": code})).await;
        }
        administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
        administrator.make("/api/v1/tasks", json!({"name": "Knots", "code": "knots"})).await;
        for (task, limit) in TASKS.into_iter().zip([40.0, 45.0]) {
            let by = json!({"method": "fixed", "limit": limit, "unit": "s"});
            let rule = json!({"in_a_row": 2, "then_more": 1});
            let standard = json!({"targets": [{"feature": "duration", "by": by}], "rule": rule});
            administrator.make(&format!("/api/v1/tasks/{task}/standards"), standard).await;
        }
        let steps = json!([{"task": "peg", "sessions": 2}, {"task": "knots"}]);
        let course = administrator.make("/api/v1/courses", json!({"name": "Basics", "steps": steps})).await;
        let groups = administrator.read("/api/v1/groups").await["items"].clone();
        for (group, (name, teacher)) in [("One", "ines"), ("Two", "omar")].into_iter().enumerate() {
            let codes: Vec<&str> = filed.groups[group].iter().map(|person| PEOPLE[*person]).collect();
            set_members(&centre, name, &[teacher], &codes).await;
            let of = groups.as_array().unwrap().iter().find(|one| one["name"] == name).unwrap();
            let path = format!("/api/v1/groups/{}/course", of["id"].as_str().unwrap());
            let follows = json!({"course": course["id"], "begins": "2026-01-01"});
            read(administrator.put(&path, follows).await, StatusCode::OK).await;
        }
        let database = centre.service.data.path().join("trocar.db");
        let planters = [Planter::open(&database).await, Planter::open_box(&database, "box-2").await];
        let mut tasks: Vec<TaskId> = Vec::new();
        for code in TASKS {
            let task = administrator.read(&format!("/api/v1/tasks/{code}")).await;
            tasks.push(task["id"].as_str().unwrap().parse().unwrap());
        }
        let mut sessions = Vec::new();
        let existing = filed.parts.iter().enumerate().filter_map(|(number, part)| Some(((*part)?, number)));
        let mut parts: Vec<(Part, usize)> = existing.collect();
        parts.sort_by_key(|(part, _)| part.at_ms());
        for (part, number) in parts {
            let (person, task) = filed.sessions[number];
            let mut planter = planters[filed.boxes[number]].clone();
            planter.task = tasks[task];
            let trainee = planter.trainee(PEOPLE[person]).await;
            sessions.push(planter.scored(trainee, part.at_ms(), vec![part.measured()]).await);
        }
        let [planter, _] = planters;
        Self { centre, planter, sessions, cuts: HashMap::new() }
    }

    /// Takes a step. `after`: where all is filed then. What has to be tracked or scored again is measured.
    async fn take(&mut self, step: Step, after: &Table) {
        match step {
            Step::Cut(number, at_s) => {
                let end_s = after.filed.parts.last().copied().flatten().unwrap().to_s;
                let made = self.planter.cut(self.sessions[number], [at_s, end_s].map(f64::from)).await;
                let second = made.second_id.unwrap();
                self.sessions.push(second);
                self.cuts.insert(second, made.id);
            }
            Step::Join(first, second) => {
                let cut = self.cuts.remove(&self.sessions[second]).unwrap();
                self.planter.join(self.sessions[first], cut).await;
            }
            step => self.correct(step).await,
        }
        let measured = |session: SessionId| {
            let number = self.sessions.iter().position(|one| *one == session).unwrap();
            after.filed.parts[number].unwrap().measured()
        };
        self.planter.finish_all(measured).await;
    }

    /// Moves, merges or separates.
    async fn correct(&self, step: Step) {
        let administrator = &self.centre.administrator;
        let merge = async |noun: &str, kept: &str, body: Value| {
            administrator.make(&format!("/api/v1/{noun}/{kept}/merges"), body).await;
        };
        let separate = async |noun: &str, kept: &str, merged: &str| {
            let merges = administrator.read(&format!("/api/v1/{noun}/{kept}/merges")).await;
            let is_live = |one: &&Value| one["separated_at"].is_null() && one["merged"]["code"] == merged;
            let id = merges["items"].as_array().unwrap().iter().find(is_live).unwrap()["id"].clone();
            let path = format!("/api/v1/{noun}/{kept}/merges/{}/separate", id.as_str().unwrap());
            read(administrator.post(&path, json!({"why": "Two."})).await, StatusCode::OK).await;
        };
        match step {
            Step::Move(number, (person, task)) => {
                let session = self.sessions[number].to_string();
                self.planter.move_session(&session, PEOPLE[person], TASKS[task]).await;
            }
            Step::Merge(kept, merged) => {
                merge("trainees", PEOPLE[kept], json!({"trainee": PEOPLE[merged], "why": "One."})).await;
            }
            Step::Separate(kept, merged) => separate("trainees", PEOPLE[kept], PEOPLE[merged]).await,
            Step::MergeBoxes(kept, merged) => {
                merge("boxes", BOXES[kept], json!({"box": BOXES[merged], "why": "One."})).await;
            }
            Step::SeparateBoxes(kept, merged) => separate("boxes", BOXES[kept], BOXES[merged]).await,
            Step::Cut(..) | Step::Join(..) => unreachable!("the caller takes them"),
        }
    }

    /// All figures of the people who are shown, without ids and times of arrival.
    async fn figures(&self, table: &Table) -> Vec<(String, Value)> {
        let mut addresses = Vec::new();
        for (_, person) in PEOPLE.iter().enumerate().filter(|(person, _)| table.is_shown(*person)) {
            let of_task = |task| format!("/api/v1/trainees/{person}/progress?task={task}");
            addresses.extend(TASKS.map(of_task));
            addresses.push(format!("/api/v1/trainees/{person}/courses"));
            addresses.extend(TASKS.map(|task| format!("/api/v1/session-count?trainee={person}&task={task}")));
        }
        let is_merged = |code: &str| table.boxes.iter().any(|merge| BOXES[merge.merged] == code);
        addresses.extend(
            BOXES.iter().filter(|code| !is_merged(code)).map(|code| format!("/api/v1/session-count?box={code}")),
        );
        let mut figures = Vec::new();
        for address in addresses {
            let mut answer = self.centre.administrator.read(&address).await;
            plain(&mut answer);
            figures.push((address, answer));
        }
        figures
    }

    fn assert_clean(&self) {
        let check = program().args(["admin", "check", "--data"]).arg(self.centre.service.data.path()).output().unwrap();
        let findings = String::from_utf8(check.stdout).unwrap();
        let is_expected = |line: &&str| line.starts_with("missing file") || line.starts_with("no data is lost");
        let unexpected: Vec<&str> = findings.lines().filter(|line| !is_expected(line)).collect();
        assert!(unexpected.is_empty(), "besides the missing files of planted sessions: {unexpected:#?}");
    }
}

/// Removes what differs between two centres: ids, times of arrival, and the resources that an answer repeats.
fn plain(value: &mut Value) {
    match value {
        Value::Object(members) => {
            for name in ["id", "trainee", "task", "standard", "cohort", "group", "course", "created_at", "groups"] {
                members.remove(name);
            }
            members.values_mut().for_each(plain);
        }
        Value::Array(items) => items.iter_mut().for_each(plain),
        Value::String(text) if text.len() == 36 && text.matches('-').count() == 4 => text.clear(),
        _ => {}
    }
}

fn step_count() -> usize {
    std::env::var_os("TROCAR_CORRECTIONS").and_then(|steps| steps.to_str()?.parse().ok()).unwrap_or(60)
}

#[tokio::test(flavor = "multi_thread")]
async fn random_corrections_and_their_reversal_leave_every_figure_right() {
    let mut table = Table::new();
    let first = table.filed.clone();
    let mut world = World::open(&first).await;
    let before = world.figures(&table).await;
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    let steps = step_count();
    let between = (steps / 20).max(30);
    for number in 1..=steps {
        let step = table.random_step(&mut random);
        table.take(step);
        world.take(step, &table).await;
        if number % between == 0 || number == steps {
            let fresh = World::open(&table.filed).await;
            let (is, wanted) = (world.figures(&table).await, fresh.figures(&table).await);
            for (is, wanted) in is.iter().zip(&wanted) {
                assert_eq!(is, wanted, "after {number} steps, the last of them {step:?}");
            }
            world.assert_clean();
        }
    }
    for step in table.reversal(&first) {
        table.take(step);
        world.take(step, &table).await;
    }
    table.filed.parts.truncate(SESSIONS);
    table.filed.sessions.truncate(SESSIONS);
    table.filed.boxes.truncate(SESSIONS);
    assert!(table.filed.parts == first.parts && table.filed.sessions == first.sessions);
    assert!(table.filed.boxes == first.boxes && table.cuts.is_empty());
    assert_eq!(world.figures(&table).await, before);
    world.assert_clean();
}
