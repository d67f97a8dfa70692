//! The audit trail shows present names, and no names of erased people.

use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::standard::{ChartDesign, StandardDefinition};
use crate::domain::text::Key;
use crate::store::PageRequest;
use crate::store::testing::TestCentre;

/// The kind and name of what each entry changed, newest first.
async fn trail(centre: &TestCentre) -> Vec<(String, Option<String>)> {
    let page = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap();
    page.items.into_iter().map(|entry| (entry.noun, entry.called)).collect()
}

#[tokio::test]
async fn changes_are_listed_under_present_names() {
    let centre = TestCentre::new().await;
    let ada = centre.trainee("Ada").await;
    let ina = centre.person("ina", Role::Instructor, None).await;
    centre.group("Mondays", &[&ina], &[&ada]).await;
    centre.session(ada.id, "a clip").await;
    let standard = StandardDefinition { targets: Vec::new(), rule: None, charts: ChartDesign::default() };
    centre.store.standards().add(&ina.scope(), centre.task.id, standard).await.unwrap();
    let trail = trail(&centre).await;
    for (noun, called) in [
        ("session", "Ada"),
        ("group", "Mondays"),
        ("person", "ina"),
        ("trainee", "Ada"),
        ("task", "Peg transfer"),
        ("standard", "Peg transfer"),
        ("box", "Box 1"),
    ] {
        let of: Vec<_> = trail.iter().filter(|(of, _)| of == noun).map(|(_, called)| called.as_deref()).collect();
        assert!(!of.is_empty() && of.iter().all(|of| *of == Some(called)), "{noun}: {of:?}");
    }
}

#[tokio::test]
async fn an_erased_person_has_no_name_in_the_trail() {
    let centre = TestCentre::new().await;
    let ada = centre.trainee("Ada").await;
    centre.session(ada.id, "a clip").await;
    centre.store.trainees().erase(&Scope::service(), &Key::from(&ada.id)).await.unwrap();
    let trail = trail(&centre).await;
    assert!(trail.iter().any(|(noun, _)| noun == "session"));
    assert!(trail.iter().all(|(_, called)| called.as_deref() != Some("Ada")), "{trail:?}");
}
