//! Ratings, comments and evidence: stored with the session, erased with it, and hidden where rating must be blind.

use crate::domain::comment::NewComment;
use crate::domain::evidence::{EvidenceRow, StretchRow};
use crate::domain::feature::StoredFeatureKey;
use crate::domain::rating::{CheckedRating, ItemMark, RatingForm};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::session::{FeatureSpace, NewResult};
use crate::domain::text::Key;
use crate::store::testing::TestCentre;
use crate::store::{PageRequest, StoreError};

fn rating(form: RatingForm, mark: u8) -> CheckedRating {
    let items = vec![ItemMark { item: "autonomy".to_owned(), mark: Some(mark), does_not_apply: false }];
    CheckedRating { form, version: 1, items, remark: Some("PLANTED-MARKER".parse().unwrap()) }
}

fn comment(text: &str) -> NewComment {
    NewComment { from_s: 2.0, to_s: None, text: text.parse().unwrap() }
}

fn evidence() -> Vec<EvidenceRow> {
    let stretch = StretchRow { from_s: 1.0, to_s: 2.0, amount: 1.0, share: None, cause: None };
    let of =
        StoredFeatureKey { feature: "idle_share".into(), tool: Some("orange".into()), space: FeatureSpace::Space3d };
    vec![EvidenceRow { of, what: Some("rest".into()), unit: Some("s".into()), stretches: vec![stretch], none: None }]
}

#[tokio::test]
async fn evidence_is_returned_as_stored_and_its_absence_is_no_empty_list() {
    let centre = TestCentre::with_camera_and_colours().await;
    let session = centre.session(centre.trainee("Ana").await.id, "video").await;
    let (sessions, service) = (centre.store.sessions(), Scope::service());
    assert_eq!(sessions.evidence(&service, session.id).await.unwrap(), None);
    let lease = centre.claim().await.unwrap();
    let result = NewResult { evidence: evidence(), ..centre.result(session.id).await };
    centre.store.jobs().finish_track(&lease, result).await.unwrap();
    assert_eq!(sessions.evidence(&service, session.id).await.unwrap(), Some(evidence()));
    let other = centre.person("omar", Role::Instructor, None).await;
    let hidden = sessions.evidence(&Scope::instructor(other.id), session.id).await;
    assert!(matches!(hidden, Err(StoreError::NotFound { .. })));
}

#[tokio::test]
async fn a_rating_is_blind_unless_the_rater_could_have_seen_another() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, one, two) = (
        centre.trainee("Ana").await,
        centre.person("ines", Role::Instructor, None).await,
        centre.person("omar", Role::Instructor, None).await,
    );
    centre.group("One", &[&one, &two], &[&ana]).await;
    let session = centre.session(ana.id, "video").await.id;
    let (one, two) = (Scope::instructor(one.id), Scope::instructor(two.id));
    let give_to = async |session, by: &Scope, form, mark| {
        centre.store.ratings().give(by, session, rating(form, mark)).await.unwrap().is_blind
    };
    let give = async |by: &Scope, form, mark| give_to(session, by, form, mark).await;
    assert!(give(&one, RatingForm::Goals, 2).await);
    assert!(give(&one, RatingForm::Goals, 3).await, "there is no other rating yet");
    assert!(give(&two, RatingForm::Goals, 5).await);
    assert!(!give(&one, RatingForm::Goals, 5).await, "the other rating could be read by now");
    assert!(!give(&one, RatingForm::Osats, 4).await, "marks read on one form influence those on another");
    let second = centre.session(ana.id, "another video").await.id;
    assert!(give_to(second, &one, RatingForm::Goals, 2).await);
    centre.store.comments().add(&two, second, comment("poor"), [2.0, 2.0]).await.unwrap();
    assert!(!give_to(second, &one, RatingForm::Osats, 1).await, "the other's comment could be read");
    let given = centre.store.ratings().given(&one, centre.task.id, RatingForm::Goals).await.unwrap();
    let mut totals: Vec<_> = given.iter().map(|rating| rating.items[0].mark).collect();
    totals.sort();
    assert_eq!(totals, [Some(2), Some(3), Some(5)], "the last blind rating of each");
}

#[tokio::test]
async fn comments_and_ratings_are_erased_with_the_trainee_and_every_change_is_audited() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, ines) = (centre.trainee("Ana").await, centre.person("ines", Role::Instructor, None).await);
    centre.group("One", &[&ines], &[&ana]).await;
    let (session, by) = (centre.session(ana.id, "video").await.id, Scope::instructor(ines.id));
    centre.store.ratings().give(&by, session, rating(RatingForm::Goals, 3)).await.unwrap();
    let said = centre.store.comments().add(&by, session, comment("here"), [2.0, 2.0]).await.unwrap();
    centre.store.comments().withdraw(&by, session, said.id).await.unwrap();
    centre.store.comments().add(&by, session, comment("there"), [2.0, 2.0]).await.unwrap();
    let audit = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap();
    let noted: Vec<_> = audit.items.iter().map(|e| (e.action.as_str(), e.noun.as_str(), e.called.as_deref())).collect();
    assert!(
        noted.starts_with(&[
            ("create", "comment", Some("Ana")),
            ("withdraw", "comment", None),
            ("create", "comment", None),
            ("create", "rating", Some("Ana")),
        ]),
        "{noted:?}"
    );
    centre.store.trainees().erase(&Scope::service(), &Key::from(&ana.id)).await.unwrap();
    assert_eq!(centre.store.count_ratings_and_comments().await, [0, 0]);
    assert!(centre.store.check().await.unwrap().is_empty());
}

#[tokio::test]
async fn a_trainee_leaves_room_for_the_comments_of_staff_who_may_delete_those_of_the_trainee() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, ines) = (centre.trainee("Ana").await, centre.person("ines", Role::Instructor, None).await);
    centre.group("One", &[&ines], &[&ana]).await;
    let account = centre.person("ana", Role::Trainee, Some(ana.id)).await;
    let (trainee, instructor) = (Scope::trainee(account.id, ana.id), Scope::instructor(ines.id));
    let (session, comments) = (centre.session(ana.id, "video").await.id, centre.store.comments());
    let add = async |by: &Scope| comments.add(by, session, comment("here"), [2.0, 2.0]).await;
    let first = add(&trainee).await.unwrap();
    for _ in 1..100 {
        add(&trainee).await.unwrap();
    }
    let refused = add(&trainee).await.unwrap_err();
    assert!(refused.to_string().contains("100 comments"), "{refused}");
    let of_instructor = add(&instructor).await.unwrap();
    assert!(matches!(comments.withdraw(&trainee, session, of_instructor.id).await, Err(StoreError::NotFound { .. })));
    comments.withdraw(&instructor, session, first.id).await.unwrap();
    let audit = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap();
    assert_eq!((audit.items[0].action.as_str(), audit.items[0].noun.as_str()), ("delete", "comment"));
    add(&trainee).await.unwrap();
}

#[tokio::test]
async fn staff_delete_the_comments_of_deleted_accounts_and_no_trainee_does() {
    let centre = TestCentre::with_camera_and_colours().await;
    centre.person("root", Role::Administrator, None).await; // one must be left when an account is deleted
    let (ana, ines) = (centre.trainee("Ana").await, centre.person("ines", Role::Instructor, None).await);
    centre.group("One", &[&ines], &[&ana]).await;
    let (session, comments) = (centre.session(ana.id, "video").await.id, centre.store.comments());
    let account = centre.person("ana", Role::Trainee, Some(ana.id)).await;
    let by = Scope::trainee(account.id, ana.id);
    let mut made = Vec::new();
    for _ in 0..2 {
        made.push(comments.add(&by, session, comment("here"), [2.0, 2.0]).await.unwrap().id);
    }
    centre.store.people().delete(&Scope::service(), account.id).await.unwrap();
    let again = centre.person("ana", Role::Trainee, Some(ana.id)).await;
    let again = Scope::trainee(again.id, ana.id);
    let listed = comments.of_session(&again, session).await.unwrap().items;
    let instructor = Scope::instructor(ines.id);
    assert!(listed.iter().all(|one| one.may_be_deleted_by(&instructor) && !one.may_be_deleted_by(&again)));
    assert!(matches!(comments.withdraw(&again, session, made[0]).await, Err(StoreError::NotFound { .. })));
    for (by, id) in [(instructor, made[0]), (Scope::service(), made[1])] {
        comments.withdraw(&by, session, id).await.unwrap();
        let audit = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap();
        assert_eq!((audit.items[0].action.as_str(), audit.items[0].noun.as_str()), ("delete", "comment"));
    }
}

#[tokio::test]
async fn only_people_rate_and_only_staff() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = centre.trainee("Ana").await;
    let account = centre.person("ana", Role::Trainee, Some(ana.id)).await;
    let session = centre.session(ana.id, "video").await.id;
    for by in [Scope::service(), Scope::trainee(account.id, ana.id)] {
        let given = centre.store.ratings().give(&by, session, rating(RatingForm::Goals, 5)).await;
        assert!(matches!(given, Err(StoreError::Forbidden { .. })), "{by:?}");
    }
    let own = Scope::trainee(account.id, ana.id);
    assert!(centre.store.comments().add(&own, session, comment("I was lost"), [2.0, 2.0]).await.is_ok());
    assert!(centre.store.ratings().given(&own, centre.task.id, RatingForm::Goals).await.is_err());
}
