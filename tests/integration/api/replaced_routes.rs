//! Routes that others replaced: old clients get the answers of the new routes, and learn the new address.

use std::collections::BTreeMap;

use reqwest::multipart::{Form, Part};
use reqwest::{Method, RequestBuilder, Response, StatusCode, header};
use serde_json::{Value, json};

use super::centre::Centre;
use super::documents::operations;
use crate::planted::{NEW_YEAR_MS, Planter, duration};
use crate::support::{Client, problem};

/// Each replaced route, and the route that replaced it.
const REPLACED: [(&str, &str); 8] = [
    ("GET /audit", "GET /audit-entries"),
    ("GET /boxes/{id}/palette", "GET /boxes/{id}/palettes"),
    ("PUT /boxes/{id}/palette", "POST /boxes/{id}/palettes"),
    ("POST /boxes/{id}/palette/preview", "POST /boxes/{id}/palettes/preview"),
    ("POST /boxes/{id}/palette/advice", "POST /boxes/{id}/palettes/advice"),
    ("DELETE /rescorings/{id}", "POST /rescorings/{id}/cancel"),
    ("DELETE /sessions/{id}/edits/{edit}", "POST /sessions/{id}/edits/{edit}/undo"),
    ("GET /trainees/{id}/course", "GET /trainees/{id}/courses"),
];

const ANNOTATIONS: &str =
    r#"{"tool_diameter_mm":8.0,"view":"top","labels":[{"frame":1,"label":"orange","x":1,"y":2,"w":3,"h":4}]}"#;

/// A route's method and its path below `/api/v1`.
fn parts(route: &str) -> (Method, &str) {
    let (method, path) = route.split_once(' ').unwrap();
    (method.parse().unwrap(), path)
}

/// A centre, and how to fill the variable parts of a path with things that exist there.
struct Filled {
    centre: Centre,
    ids: [(&'static str, String); 5],
}

impl Filled {
    /// A centre with a rescoring and an edit, which can be called off.
    async fn open() -> Self {
        let centre = Centre::open().await;
        let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
        let ada = planter.trainee("ada").await;
        planter.result(ada, NEW_YEAR_MS, vec![duration(40.0, 1.0)], ("7", "valid")).await;
        let rescoring = text(&centre.administrator.make("/api/v1/tasks/peg/rescorings", json!({})).await["id"]);
        let session = text(&centre.administrator.read("/api/v1/sessions").await["items"][0]["id"]);
        let aside = json!({"kind": "set_aside", "why": "Interrupted."});
        let edit = text(&centre.administrator.make(&format!("/api/v1/sessions/{session}/edits"), aside).await["id"]);
        let ids = [
            ("boxes/{id}", "boxes/box-1".to_owned()),
            ("trainees/{id}", "trainees/ada".to_owned()),
            ("rescorings/{id}", format!("rescorings/{rescoring}")),
            ("sessions/{id}", format!("sessions/{session}")),
            ("{edit}", edit),
        ];
        Self { centre, ids }
    }

    fn address(&self, path: &str) -> String {
        self.ids.iter().fold(format!("/api/v1{path}"), |path, (name, value)| path.replace(name, value))
    }

    fn request(&self, client: &Client, route: &str) -> RequestBuilder {
        let (method, path) = parts(route);
        let request = client.request(method.clone(), &self.address(path));
        match path.rsplit('/').next() {
            Some("palette" | "palettes") if method != Method::GET => request.multipart(
                Form::new().text("annotations", ANNOTATIONS).part("video", Part::bytes(b"x").file_name("clip.mp4")),
            ),
            Some("advice") => request.multipart(Form::new().part("picture", Part::bytes(b"x").file_name("a.jpg"))),
            Some("preview") => request.multipart(Form::new().text("annotations", ANNOTATIONS)), // without a picture
            _ => request,
        }
    }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

/// The headers that name a new address.
fn new_address(answer: &Response) -> Option<(&str, &str)> {
    let text = |name| answer.headers().get(name).map(|value: &header::HeaderValue| value.to_str().unwrap());
    text("deprecation").zip(text("link"))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_replaced_route_answers_as_the_new_one_and_names_it() {
    let filled = Filled::open().await;
    let centre = &filled.centre;
    let stranger = centre.service.stranger();
    let clients = [
        (&stranger, "a stranger"),
        (&centre.trainee, "a trainee"),
        (&centre.other_instructor, "another instructor"),
        (&centre.administrator, "an administrator"),
    ];
    for (old, new) in REPLACED {
        for (client, who) in clients {
            let before = filled.request(client, old).send().await.unwrap();
            let after = filled.request(client, new).send().await.unwrap();
            let link = format!("<{}>; rel=\"successor-version\"", filled.address(parts(new).1));
            let (since, named) = new_address(&before).unwrap_or_else(|| panic!("{old} names no new address"));
            assert!(since.starts_with('@') && named == link, "{old}: {since} {named}");
            assert_eq!(new_address(&after), None, "{new}");
            assert_eq!(before.status(), after.status(), "{who}: {old}");
            if who == "an administrator" {
                assert_eq!(after.status().is_success(), !new.ends_with("/preview"), "{new}: {}", after.status());
            }
            assert_eq!(before.text().await.unwrap(), after.text().await.unwrap(), "{who}: {old}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_address_with_a_replaced_route_keeps_its_other_methods() {
    let filled = Filled::open().await;
    let administrator = &filled.centre.administrator;
    let rescoring = filled.address("/rescorings/{id}");
    assert_eq!(new_address(&administrator.get(&rescoring).await), None, "only its DELETE was replaced");
    let palette = filled.address("/boxes/{id}/palette");
    assert_eq!(administrator.head(&palette).await.status(), StatusCode::OK);
    problem(administrator.patch(&palette, Value::Null).await, 405, "method-not-allowed").await;
    problem(administrator.put(&filled.address("/boxes/{id}/palettes"), Value::Null).await, 405, "method-not-allowed")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_description_marks_replaced_routes_and_no_others_as_deprecated() {
    let centre = Centre::open().await;
    let document = centre.administrator.read("/api/v1/openapi.json").await;
    let described: BTreeMap<String, &Value> = operations(&document)
        .into_iter()
        .map(|(path, method, operation)| (format!("{} {path}", method.to_uppercase()), operation))
        .collect();
    let full = |route: &str| route.replace(" /", " /api/v1/");
    let deprecated: Vec<&String> =
        described.iter().filter(|(_, operation)| operation["deprecated"] == true).map(|(route, _)| route).collect();
    let mut expected = REPLACED.map(|(old, _)| full(old));
    expected.sort();
    assert_eq!(deprecated, expected.iter().collect::<Vec<_>>());
    for (old, new) in REPLACED {
        let [before, after] = [old, new].map(|route| described[&full(route)]);
        for part in ["summary", "parameters", "requestBody", "responses", "security", "tags"] {
            assert_eq!(before[part], after[part], "{part} of {old}");
        }
        assert!(before["description"].as_str().unwrap().contains(&format!("`{}`", full(new))), "{old}: {before}");
    }
}
