//! The forms: a closed list. Item names are those of the papers; the anchors are in our own words.
//!
//! OSATS: the global rating scale of Martin JA et al., "Objective structured assessment of technical skill (OSATS) for
//! surgical residents", Br J Surg 1997;84:273–278. GOALS: Vassiliou MC et al., "A global assessment tool for evaluation
//! of intraoperative laparoscopic skills", Am J Surg 2005;190:107–113. A change of wording needs a new version: ratings
//! made with different wordings are not compared.
//!
//! The form for box trainers is our own and not validated. It has the items of these two forms that can be judged in a box
//! without tissue, assistants or a procedure, each with the form that it is taken from.

use serde::Serialize;
use utoipa::ToSchema;

use super::{MARK_RANGE, RatingForm};

/// A form as shown to raters.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FormInfo {
    /// The form's stable name.
    pub form: RatingForm,
    /// Version of the wording.
    pub version: i64,
    /// Title for people.
    pub title: &'static str,
    /// The publication; for the service's own form, the forms that its items are taken from.
    pub source: &'static str,
    /// False for the service's own form, which has not been validated.
    pub is_published: bool,
    /// Its items, in order.
    pub items: &'static [ItemInfo],
    /// The lowest mark of an item.
    pub least: u8,
    /// The highest mark of an item.
    pub most: u8,
}

/// An item of a form.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct ItemInfo {
    /// Stable name.
    pub name: &'static str,
    /// Title for people.
    pub title: &'static str,
    /// In the service's own form: the item of a published form that it is taken from.
    pub source: Option<&'static str>,
    /// What the marks 1, 3 and 5 mean.
    pub anchors: [Anchor; 3],
}

/// The meaning of a mark.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct Anchor {
    /// The mark.
    pub mark: u8,
    /// The meaning in words.
    pub words: &'static str,
}

impl FormInfo {
    /// All forms.
    pub fn all() -> Vec<Self> {
        RatingForm::ALL.iter().map(|form| Self::of(*form)).collect()
    }

    /// One form.
    pub fn of(form: RatingForm) -> Self {
        let (title, source, items) = match form {
            RatingForm::Osats => ("OSATS global rating scale", "Martin et al., Br J Surg 1997;84:273–278", OSATS),
            RatingForm::Goals => ("GOALS", "Vassiliou et al., Am J Surg 2005;190:107–113", GOALS),
            RatingForm::BoxTrainer => ("Box trainer form", BOX_TRAINER_SOURCE, BOX_TRAINER),
        };
        let is_published = form != RatingForm::BoxTrainer;
        Self { form, version: 1, title, source, is_published, items, least: MARK_RANGE.0, most: MARK_RANGE.1 }
    }
}

const BOX_TRAINER_SOURCE: &str = "items of OSATS (Martin et al., Br J Surg 1997;84:273–278) and GOALS (Vassiliou et al., \
                                  Am J Surg 2005;190:107–113) that can be judged in a box";

const fn item(name: &'static str, title: &'static str, [low, middle, high]: [&'static str; 3]) -> ItemInfo {
    let anchors = [Anchor { mark: 1, words: low }, Anchor { mark: 3, words: middle }, Anchor { mark: 5, words: high }];
    ItemInfo { name, title, source: None, anchors }
}

/// An item of the service's own form, and the published item that it is taken from.
const fn own_item(
    name: &'static str,
    title: &'static str,
    source: &'static str,
    [low, middle, high]: [&'static str; 3],
) -> ItemInfo {
    ItemInfo { source: Some(source), ..item(name, title, [low, middle, high]) }
}

const OSATS: &[ItemInfo] = &[
    item(
        "respect_for_tissue",
        "Respect for tissue",
        [
            "Often uses more force than needed, or damages tissue by the wrong use of instruments",
            "Handles tissue with care and now and then damages it unintentionally",
            "Always handles tissue as it should be, with next to no damage",
        ],
    ),
    item(
        "time_and_motion",
        "Time and motion",
        [
            "Many moves that are not needed",
            "Efficient, with some moves that are not needed",
            "No move too many, and the most made of each",
        ],
    ),
    item(
        "instrument_handling",
        "Instrument handling",
        [
            "Tentative or awkward with instruments again and again",
            "Competent with instruments, at times stiff or awkward",
            "Fluid with instruments, never awkward",
        ],
    ),
    item(
        "knowledge_of_instruments",
        "Knowledge of instruments",
        [
            "Often asks for the wrong instrument, or uses one for what it is not made for",
            "Knows most instruments and takes the right one for the step",
            "Is plainly familiar with the instruments and what each is called",
        ],
    ),
    item(
        "use_of_assistants",
        "Use of assistants",
        [
            "Places assistants badly, or does without their help where it is needed",
            "Makes good use of assistants most of the time",
            "Uses assistants so that they help most, at every moment",
        ],
    ),
    item(
        "flow",
        "Flow of operation and forward planning",
        [
            "Stops often, or has to talk over what comes next",
            "Plans ahead and goes on steadily",
            "Has plainly planned the whole course, one step running into the next",
        ],
    ),
    item(
        "knowledge_of_procedure",
        "Knowledge of the specific procedure",
        [
            "Lacks knowledge and needs to be told most steps",
            "Knows all the important steps",
            "Is familiar with every part of the procedure",
        ],
    ),
];

const GOALS: &[ItemInfo] = &[
    item(
        "depth_perception",
        "Depth perception",
        [
            "Overshoots all the time, swings wide, and is slow to correct",
            "Overshoots or misses now and then, and is quick to correct",
            "Takes instruments to the target in the right plane without a miss",
        ],
    ),
    item(
        "bimanual_dexterity",
        "Bimanual dexterity",
        [
            "Uses one hand alone, or the two without regard to each other",
            "Uses both hands, without the best of their working together",
            "Both hands complement each other for the best exposure",
        ],
    ),
    item(
        "efficiency",
        "Efficiency",
        [
            "Uncertain and laborious, with many tries, or changes of aim without progress",
            "Slow, but planned and in reasonable order",
            "Sure and safe, and stays on what is to be done until another way is plainly better",
        ],
    ),
    item(
        "tissue_handling",
        "Tissue handling",
        [
            "Rough: tears tissue, injures what is beside it, loses grip",
            "Handles tissue reasonably well, with slight damage beside it and some lost grips",
            "Handles tissue well, with the right pull and hardly any damage beside it",
        ],
    ),
    item(
        "autonomy",
        "Autonomy",
        [
            "Cannot finish, even when told how",
            "Finishes safely with moderate guidance",
            "Finishes alone, without being told",
        ],
    ),
];

const BOX_TRAINER: &[ItemInfo] = &[
    own_item(
        "box_depth_perception",
        "Depth perception",
        "GOALS, depth perception",
        [
            "Overshoots the target again and again, and is slow to correct",
            "Overshoots or misses now and then, and is quick to correct",
            "Takes the instruments to the target in the right plane without a miss",
        ],
    ),
    own_item(
        "box_bimanual_dexterity",
        "Bimanual dexterity",
        "GOALS, bimanual dexterity",
        [
            "Uses one hand alone, or both without coordination",
            "Uses both hands, but they do not always help each other",
            "Both hands work together: one prepares what the other does",
        ],
    ),
    own_item(
        "box_object_handling",
        "Handling of objects and material",
        "GOALS, tissue handling, and OSATS, respect for tissue, for the objects and material of a box",
        [
            "Often drops, tears or bends objects, or uses more force than needed",
            "Handles objects with care, with a few drops or slight damage",
            "Grips securely with the right force, without drops or damage",
        ],
    ),
    own_item(
        "box_instrument_handling",
        "Instrument handling",
        "OSATS, instrument handling",
        [
            "Tentative or awkward with the instruments again and again",
            "Competent with the instruments, at times stiff or awkward",
            "Fluid with the instruments, never awkward",
        ],
    ),
    own_item(
        "box_time_and_motion",
        "Time and motion",
        "OSATS, time and motion, and GOALS, efficiency",
        [
            "Many moves that are not needed, many attempts",
            "Efficient, with some moves that are not needed",
            "No move too many, each attempt succeeds",
        ],
    ),
    own_item(
        "box_flow",
        "Flow and forward planning",
        "OSATS, flow of operation and forward planning",
        [
            "Stops often and seems unsure what comes next",
            "Plans ahead and goes on steadily",
            "Has plainly planned the whole course, one step running into the next",
        ],
    ),
];
