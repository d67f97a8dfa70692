//! Role × route × {own, other, missing}: every route that the service describes, by each caller, as `table.txt` says. A
//! route without a line there fails the test, and so does a line without a route.

mod subjects;

use std::collections::BTreeSet;

use reqwest::multipart::Form;
use reqwest::{Method, RequestBuilder, header};
use serde_json::Value;

use self::subjects::{Caller, FilledCentre, Subject, upload_of};
use super::centre::recording;
use super::documents::operations;

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
/// In the order of the table's columns.
const ROLES: [&str; 4] = ["agent", "trainee", "instructor", "administrator"];
/// In the order of a role's answers.
const SIDES: [&str; 3] = ["own", "other", "missing"];

/// A line of the table.
struct Rule {
    method: Method,
    /// The address with its variable parts.
    path: &'static str,
    subject: &'static str,
    /// The answers of each role, in the order of [`SIDES`].
    answers: [&'static str; 4],
    body: &'static str,
}

impl Rule {
    fn parse(line: &'static str) -> Self {
        let (method, rest) = line.split_once(char::is_whitespace).unwrap();
        let (method, mut rest) = (method.parse().unwrap(), rest.trim_start());
        let mut word = || {
            let (first, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            rest = after.trim_start();
            first
        };
        let (path, subject) = (word(), word());
        let answers = [word(), word(), word(), word()];
        let sides = answers[0].len();
        let mut plain = answers.iter().map(|of| of.trim_start_matches('*'));
        let known = plain.all(|of| of.len() == sides && of.chars().all(|answer| "yn-?".contains(answer)));
        assert!(known && (sides == 1 || sides == SIDES.len()), "each role needs one answer or three: {line}");
        Self { method, path, subject, answers, body: rest }
    }

    /// The route as the service describes it.
    fn route(&self) -> String {
        let path = self.path.split('?').next().unwrap();
        let parts = path.split('/').map(|part| match part.split_once('=') {
            Some((name, _)) => format!("{name}}}"),
            None => part.to_owned(),
        });
        format!("{} {}", self.method, parts.collect::<Vec<_>>().join("/"))
    }

    /// The expected answer.
    fn expected(&self, caller: &Caller, side: usize) -> char {
        match caller.role {
            Some(role) => match self.answers[role].strip_prefix('*') {
                Some(_) if caller.is_by_token => 'n',
                Some(signed_in) => signed_in.chars().nth(side).unwrap(),
                None => self.answers[role].chars().nth(side).unwrap(),
            },
            // A stranger gets what an agent gets.
            None if self.subject == "public" => self.answers[0].chars().nth(side).unwrap(),
            None => 'x',
        }
    }

    /// The address of a subject.
    fn address(&self, subject: &Subject) -> String {
        let (path, query) = self.path.split_once('?').unwrap_or((self.path, ""));
        let parts = path.split('/').map(|part| match (part, part.split_once('=')) {
            (_, Some((_, fixed))) => fixed.trim_end_matches('}').to_owned(),
            ("{id}", None) => subject.id.clone(),
            (variable, None) if variable.starts_with('{') => subject.part.clone(),
            (fixed, None) => fixed.to_owned(),
        });
        let address = parts.collect::<Vec<_>>().join("/");
        if query.is_empty() { address } else { format!("{address}?{}", query.replace("$id", &subject.id)) }
    }

    /// The request, with its body and headers.
    fn request(&self, world: &mut FilledCentre, caller: usize, subject: &Subject) -> RequestBuilder {
        let unique = world.unique();
        let request = world.callers[caller].client.request(self.method.clone(), &self.address(subject));
        let request = if self.path.starts_with("/api/v1/uploads") { self.of_tus(request, subject) } else { request };
        let content = |request: RequestBuilder, kind: &str| request.header(header::CONTENT_TYPE, kind);
        match self.body {
            "" => request,
            "form" => request.multipart(Form::new().text("note", "x")),
            "clip" => content(request, "video/mp4").body(recording(100, 1_000_000 + unique)),
            "table" => content(request, "text/csv").body("nonsense"),
            "websocket" => request
                .header(header::CONNECTION, "Upgrade")
                .header(header::UPGRADE, "websocket")
                .header(header::SEC_WEBSOCKET_VERSION, "13")
                .header(header::SEC_WEBSOCKET_KEY, "dGhlIHNhbXBsZSBub25jZQ=="),
            json => {
                let json = json.replace("$course", &world.course).replace("$unique", &format!("Plan of {unique}"));
                let json = json.replace("$id", &subject.id);
                content(request, "application/json").body(json)
            }
        }
    }

    fn of_tus(&self, request: RequestBuilder, subject: &Subject) -> RequestBuilder {
        let request = request.header("tus-resumable", "1.0.0");
        match self.method {
            Method::POST => request.header("upload-length", 5).header("upload-metadata", upload_of(&subject.id)),
            Method::PATCH => request
                .header("upload-offset", 0)
                .header(header::CONTENT_TYPE, "application/offset+octet-stream")
                .body(""),
            _ => request,
        }
    }
}

/// What a caller can distinguish.
struct Answer {
    /// One of the table's letters, `x` for 401 and `5` for a fault of the service.
    code: char,
    /// Status, headers and body, with the id that was asked for taken out.
    bytes: String,
}

async fn ask(request: RequestBuilder, subject: &Subject) -> Answer {
    let answer = request.send().await.unwrap();
    let status = answer.status();
    let streams = |kind: &header::HeaderValue| kind.as_bytes().starts_with(b"text/event-stream");
    let never_ends = status.as_u16() == 101 || answer.headers().get(header::CONTENT_TYPE).is_some_and(streams);
    let mut headers: Vec<String> = answer
        .headers()
        .iter()
        .filter(|(name, _)| *name != "x-request-id" && *name != "date")
        .map(|(name, value)| format!("{name}: {}", String::from_utf8_lossy(value.as_bytes())))
        .collect();
    headers.sort();
    let body = if never_ends { String::new() } else { answer.text().await.unwrap_or_default() };
    let problem: Value = serde_json::from_str(&body).unwrap_or_default();
    let code = match (status.as_u16(), problem["type"].as_str()) {
        (500.., _) => '5',
        (401, None | Some("/problems/not-signed-in")) => 'x',
        (403, _) => 'n',
        (404, _) => '-',
        (_, Some("/problems/unknown-reference")) => '?',
        _ => 'y',
    };
    let mut bytes = format!("{status}\n{}\n\n{body}", headers.join("\n"));
    for id in [&subject.id, &subject.part] {
        if !id.is_empty() {
            bytes = bytes.replace(id.as_str(), "ID");
        }
    }
    Answer { code, bytes }
}

fn rules() -> Vec<Rule> {
    let lines = include_str!("table.txt").lines();
    lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(Rule::parse).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn each_caller_gets_what_the_table_says_on_each_route() {
    let mut world = FilledCentre::open().await;
    let rules = rules();
    let listed = world.routes().await;
    let listed: BTreeSet<String> =
        operations(&listed).into_iter().map(|(path, method, _)| format!("{} {path}", method.to_uppercase())).collect();
    let ruled: BTreeSet<String> = rules.iter().map(Rule::route).collect();
    let without_rule: Vec<_> = listed.difference(&ruled).collect();
    assert!(
        without_rule.is_empty(),
        "say in tests/integration/api/rights/table.txt who may do this: {without_rule:#?}"
    );
    let without_route: Vec<_> = ruled.difference(&listed).collect();
    assert!(without_route.is_empty(), "these lines of the table are of no route: {without_route:#?}");

    let (mut asked, mut wrong) = (0, Vec::new());
    for rule in &rules {
        for caller in 0..world.callers.len() {
            if is_left_out(rule, &world.callers[caller]) {
                continue;
            }
            let mut hidden: Option<Answer> = None;
            for (side, name) in SIDES.into_iter().enumerate().take(rule.answers[0].len()) {
                let subject = match (rule.answers[0].len(), name) {
                    (1, _) | (_, "missing") => Subject::missing(),
                    _ => world.subject(rule.subject, side, caller, rule.method == Method::DELETE).await,
                };
                let request = rule.request(&mut world, caller, &subject);
                let answer = ask(request, &subject).await;
                asked += 1;
                let expected = rule.expected(&world.callers[caller], side);
                let what = format!("{} {} by {}, {name}", rule.method, rule.path, world.callers[caller].name);
                if answer.code != expected {
                    wrong.push(format!("{what}: expected `{expected}`, got {}", answer.bytes));
                }
                if let Some(other) =
                    hidden.filter(|other| matches!(other.code, '-' | '?') && other.bytes != answer.bytes)
                {
                    wrong.push(format!("{what}, differs from another's: {}\n{}", other.bytes, answer.bytes));
                }
                hidden = (name == "other").then_some(answer);
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {asked} answers:\n{}", wrong.len(), wrong.join("\n"));
    assert!(asked > 2_000, "only {asked} requests were made");
}

/// Signing out would end the cookies of the other lines.
fn is_left_out(rule: &Rule, caller: &Caller) -> bool {
    rule.subject == "tokens" && caller.role.is_some() && !caller.is_by_token
}

#[test]
fn a_line_names_its_route_and_its_address() {
    let rule =
        Rule::parse("PUT     /api/v1/boxes/{id=box-one}/feed.ts?trainee=$id trainee yy? y?? y?? yy?  {\"a\": 1}");
    assert_eq!(rule.route(), "PUT /api/v1/boxes/{id}/feed.ts");
    assert_eq!(rule.address(&Subject::missing()), format!("/api/v1/boxes/box-one/feed.ts?trainee={MISSING}"));
    assert_eq!((rule.subject, rule.answers[3], rule.body), ("trainee", "yy?", "{\"a\": 1}"));
}
