//! What the centre's people talk about, parsed once at the rim: a value of these types is valid.
//!
//! | file | holds |
//! |---|---|
//! | [`text`] | names, codes, keys, file names: text with limits |
//! | [`role`] | what somebody is |
//! | [`scope`] | what somebody may see and change |
//! | [`secret`] | tokens, cookies and passwords, and what is kept of them |
//! | [`boxes`] | a box trainer: from where its camera looks |
//! | [`trainee`] | level and handedness |
//! | [`enrolment`] | many trainees at once |
//! | [`task`] | an exercise's description |
//! | [`feature`] | which features there are, and which one of them is meant |
//! | [`evidence`] | the seconds that made a session's features |
//! | [`advice`] | what to work on next, by rules |
//! | [`rating`] | instructors' forms, and what they give on them |
//! | [`comment`] | what somebody says about a second |
//! | [`edit`] | what people change about a scored session |
//! | [`standard`] | what a task asks for: targets, pass rule, charts |
//! | [`cohort`] | who is in a reference group |
//! | [`course`] | what a course asks for: steps, each with a task |
//! | [`calibration`] | a version of a box's camera |
//! | [`photo_check`] | what one photo of a checkerboard is good for |
//! | [`palette`] | a version of a box's colour samples |
//! | [`self_test`] | a box's traffic light |
//! | [`blob`] | files by their content |
//! | [`job`] | kinds and states of work, and what it is about |
//! | [`feed`] | frames that arrive while they are recorded: records, words, numbers |
//! | [`rescoring`] | scoring sessions again: what is ordered, what changed |
//! | [`session`] | states of a recording, versions and features of its result |
//! | [`skill`] | a model of skill: as it is kept, told and read from a file |
//! | [`xapi`] | sessions as statements for learning record stores |
//! | [`problem`] | why something did not work, for people |
//! | [`files`] | exchange formats: camera.json, annotations.json, trajectories, features, truth |

pub mod advice;
pub mod blob;
pub mod boxes;
pub mod calibration;
pub mod cohort;
pub mod comment;
pub mod course;
pub mod edit;
pub mod enrolment;
pub mod evidence;
pub mod feature;
pub mod feed;
pub mod files;
pub mod job;
pub mod palette;
pub mod photo_check;
pub mod problem;
pub mod rating;
pub mod rescoring;
pub mod role;
pub mod scope;
pub mod secret;
pub mod self_test;
pub mod session;
pub mod skill;
pub mod standard;
pub mod task;
pub mod text;
pub mod trainee;
pub mod xapi;

/// An enumeration whose values have one name each, in files, API and database alike.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident: $what:literal { $($(#[$variant_doc:meta])* $variant:ident = $text:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
        pub enum $name { $($(#[$variant_doc])* #[serde(rename = $text)] $variant,)* }

        impl $name {
            /// All values.
            pub const ALL: &[$name] = &[$($name::$variant),*];

            /// The value's one name.
            pub fn name(self) -> &'static str {
                match self { $($name::$variant => $text,)* }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $name {
            type Err = crate::domain::text::Invalid;

            fn from_str(text: &str) -> Result<Self, Self::Err> {
                match text {
                    $($text => Ok($name::$variant),)*
                    _ => Err(crate::domain::text::Invalid::new($what, concat!("expected one of" $(, " ", $text)*))),
                }
            }
        }
    };
}
pub(crate) use named;
