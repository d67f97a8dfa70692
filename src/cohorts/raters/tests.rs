//! Agreement of raters, and correlations of ratings with features.

use super::*;
use crate::domain::rating::ItemMark;
use crate::domain::session::FeatureSpace;
use crate::ids::CalibrationId;

/// Shrout and Fleiss's six people by four raters (1979, table 2).
const PUBLISHED: [[u8; 4]; 6] = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]];

struct Ids {
    people: Vec<TraineeId>,
    raters: Vec<PersonId>,
    sessions: Vec<SessionId>,
}

impl Ids {
    fn new(people: i64) -> Self {
        Self {
            people: (0..people).map(TraineeId::at).collect(),
            raters: (0..4).map(PersonId::at).collect(),
            sessions: (0..2 * people).map(SessionId::at).collect(),
        }
    }

    /// A rating of a person's first or second session.
    fn rating(&self, person: usize, second: usize, rater: usize, marks: &[Option<u8>]) -> GivenRating {
        let item = |mark: &Option<u8>| ItemMark { item: "item".to_owned(), mark: *mark, does_not_apply: false };
        let items = marks.iter().map(item).collect();
        GivenRating {
            session: self.sessions[2 * person + second],
            recorded_at_ms: second as i64,
            trainee: self.people[person],
            rater: self.raters[rater],
            items,
        }
    }
}

/// The rating with another item, which does not apply or has a mark.
fn with_item(mut rating: GivenRating, mark: Option<u8>) -> GivenRating {
    rating.items.push(ItemMark { item: "other".to_owned(), mark, does_not_apply: mark.is_none() });
    rating
}

fn published(ids: &Ids) -> Vec<GivenRating> {
    let of_person = |(person, marks): (usize, &[u8; 4])| {
        marks.iter().enumerate().map(|(rater, mark)| ids.rating(person, 1, rater, &[Some(*mark)])).collect::<Vec<_>>()
    };
    PUBLISHED.iter().enumerate().flat_map(of_person).collect()
}

#[test]
fn the_published_example_has_its_published_agreement() {
    let answer = agreement_of(RatingForm::Osats, &published(&Ids::new(6)));
    let (single, mean) = (answer.single.unwrap(), answer.mean.unwrap());
    assert!((single.value - 0.29).abs() < 0.005 && (mean.value - 0.62).abs() < 0.005, "{answer:?}");
    assert!((single.low - 0.019).abs() < 1e-3 && (single.high - 0.761).abs() < 1e-3, "{answer:?}");
    assert_eq!((answer.people, answer.raters, answer.sessions, answer.left_out), (6, 4, 6, 0));
}

#[test]
fn raters_with_many_sessions_of_few_people_do_not_hide_raters_of_many_people() {
    let ids = Ids { sessions: (0..80).map(SessionId::at).collect(), ..Ids::new(16) };
    let mark = |session: usize, person: usize, rater: usize| GivenRating {
        session: ids.sessions[session],
        trainee: ids.people[person],
        ..ids.rating(0, 0, rater, &[Some((1 + (session + rater) % 9) as u8)])
    };
    let often = (0..60).flat_map(|session| [mark(session, session % 3, 0), mark(session, session % 3, 1)]);
    let wide = (3..16).flat_map(|person| [mark(60 + person, person, 2), mark(60 + person, person, 3)]);
    let answer = agreement_of(RatingForm::Osats, &often.chain(wide).collect::<Vec<_>>());
    assert_eq!((answer.people, answer.raters), (13, 2), "{answer:?}");
    assert!(answer.single.is_some());
}

#[test]
fn an_older_session_and_a_rating_with_a_gap_change_nothing() {
    let ids = Ids::new(7);
    let mut given = published(&ids);
    let whole = agreement_of(RatingForm::Osats, &given);
    given.extend((0..4).map(|rater| ids.rating(2, 0, rater, &[Some(1)])));
    given.extend((0..4).map(|rater| ids.rating(6, 1, rater, &[Some(5), None])));
    let answer = agreement_of(RatingForm::Osats, &given);
    assert_eq!((answer.single, answer.people, answer.sessions, answer.left_out), (whole.single, 6, 7, 1));
}

#[test]
fn ratings_of_other_items_are_left_out_and_counted() {
    let ids = Ids::new(7);
    let published = published(&ids);
    let whole = agreement_of(RatingForm::Osats, &published);
    // The same marks of a longer form whose other item does not apply, and one that has a mark for it.
    let mut given: Vec<GivenRating> = published.into_iter().map(|rating| with_item(rating, None)).collect();
    given.extend((0..4).map(|rater| with_item(ids.rating(6, 1, rater, &[Some(5)]), Some(5))));
    let answer = agreement_of(RatingForm::Osats, &given);
    assert_eq!((answer.single, answer.mean, answer.people, answer.sessions), (whole.single, whole.mean, 6, 6));
    assert_eq!((answer.items, answer.other_items), (vec!["item".to_owned()], 4));
    // A session whose two raters judged different items says nothing about their agreement.
    let mixed: Vec<GivenRating> = (0..7)
        .flat_map(|person| {
            [ids.rating(person, 0, 0, &[Some(3)]), with_item(ids.rating(person, 0, 1, &[Some(3)]), Some(3))]
        })
        .collect();
    let answer = agreement_of(RatingForm::Osats, &mixed);
    assert_eq!((answer.people, answer.sessions, answer.withheld.unwrap().missing), (0, 0, Some(6)));
}

#[test]
fn correlations_use_the_items_that_most_people_were_rated_on() {
    let ids = Ids::new(12);
    let (given, _) = measured(&ids);
    let number = |rating: &GivenRating| ids.people.iter().position(|id| *id == rating.trainee).unwrap();
    let mixed: Vec<GivenRating> =
        given.iter().map(|rating| with_item(rating.clone(), (number(rating) < 2).then_some(5))).collect();
    let (compared, used) = most_people(&mixed, people_rated);
    assert_eq!((compared.items, compared.other_items), (vec!["item".to_owned()], 4));
    assert!(used.iter().all(|rating| number(rating) >= 2) && people_rated(&used) == 10);
}

#[test]
fn too_few_people_rated_by_the_same_raters_give_a_reason() {
    let ids = Ids::new(6);
    let five: Vec<GivenRating> = published(&ids).into_iter().filter(|rating| rating.trainee != ids.people[3]).collect();
    let answer = agreement_of(RatingForm::Goals, &five);
    assert_eq!((answer.single, answer.withheld.unwrap().missing), (None, Some(1)));
    let alone: Vec<GivenRating> = published(&ids).into_iter().filter(|rating| rating.rater == ids.raters[0]).collect();
    assert_eq!(agreement_of(RatingForm::Goals, &alone).withheld.unwrap().missing, Some(6));
}

fn value(ids: &Ids, person: usize, second: usize, feature: &str, tool: Option<&str>, value: f64) -> SessionValue {
    SessionValue {
        session: ids.sessions[2 * person + second],
        handedness: Some(if person == 0 { Handedness::Left } else { Handedness::Right }),
        pipeline: "9".to_owned(),
        calibration: CalibrationId::at(1),
        of: FeatureKey::of_tool(features::find(feature).unwrap(), tool.map(str::to_owned), FeatureSpace::Space3d),
        value,
    }
}

/// Twelve people, each rated twice. Better-rated people are faster; a second feature is unrelated to the ratings.
fn measured(ids: &Ids) -> (Vec<GivenRating>, Vec<SessionValue>) {
    let noise = [5.0, 1.0, 9.0, 3.0, 7.0, 2.0, 8.0, 4.0, 6.0, 0.0, 5.5, 2.5];
    let mut given = Vec::new();
    let mut values = Vec::new();
    for (person, noise) in noise.into_iter().enumerate() {
        for second in 0..2 {
            let mark = 10 + 3 * person as u8 + second as u8;
            given.push(ids.rating(person, second, 0, &[Some(mark)]));
            let seconds = 200.0 - 10.0 * person as f64 + if person % 4 == 0 { 25.0 } else { 0.0 };
            values.push(value(ids, person, second, "duration", None, seconds));
            values.push(value(ids, person, second, "path_length", Some("left"), noise));
        }
    }
    (given, values)
}

#[test]
fn a_person_counts_once_and_a_real_correlation_is_found_beside_noise() {
    let ids = Ids::new(12);
    let (given, values) = measured(&ids);
    let answer = correlations_of(RatingForm::Osats, &given, &totals(&given), values);
    assert_eq!((answer.people, answer.sessions, answer.asked), (12, 24, 2));
    let [duration, path] = [&answer.items[0], &answer.items[1]];
    assert_eq!(
        (duration.of.feature.name, duration.people, duration.found, duration.better),
        ("duration", 12, true, "lower")
    );
    assert!(duration.rho.unwrap().value < -0.8, "{duration:?}");
    assert!(duration.adjusted.unwrap() >= duration.chance.unwrap());
    assert_eq!(
        (path.people, path.handedness, path.found),
        (11, Some(Handedness::Right), false),
        "one prefers the other hand"
    );
}

#[test]
fn the_hand_that_most_people_prefer_is_compared() {
    let ids = Ids::new(12);
    let (given, mut values) = measured(&ids);
    let number = |value: &SessionValue| ids.sessions.iter().position(|id| *id == value.session).unwrap();
    // Five left-handers with two sessions each, seven others with one.
    values.retain(|value| number(value) < 10 || number(value).is_multiple_of(2));
    for value in &mut values {
        value.handedness = Some(if number(value) < 10 { Handedness::Left } else { Handedness::Right });
    }
    let answer = correlations_of(RatingForm::Osats, &given, &totals(&given), values);
    let path = answer.items.iter().find(|row| row.of.feature.name == "path_length").unwrap();
    assert_eq!((path.people, path.handedness), (7, Some(Handedness::Right)));
}

#[test]
fn too_few_people_give_no_correlation_and_other_versions_count_for_nothing() {
    let ids = Ids::new(12);
    let (given, values) = measured(&ids);
    let nine: Vec<GivenRating> =
        given.iter().filter(|rating| ids.people[..9].contains(&rating.trainee)).cloned().collect();
    let few = correlations_of(RatingForm::Osats, &nine, &totals(&nine), values[..36].to_vec());
    assert_eq!((few.items.len(), few.withheld.unwrap().missing), (0, Some(1)));
    let mut mixed = values;
    mixed.iter_mut().take(8).for_each(|value| value.pipeline = "8".to_owned());
    let answer = correlations_of(RatingForm::Osats, &given, &totals(&given), mixed);
    assert_eq!((answer.people, answer.pipeline.as_deref()), (10, Some("9")));
}
