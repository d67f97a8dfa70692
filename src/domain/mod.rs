//! The centre's domain types. Input is parsed once at the outer layer, so every value of these types is valid.
//!
//! | file | holds |
//! |---|---|
//! | [`text`] | names, codes, keys, file names: text with limits |
//! | [`role`] | roles of users and agents |
//! | [`scope`] | what a user or agent may see and change |
//! | [`rights`] | what instructors may do beyond their own groups |
//! | [`secret`] | tokens, cookies and passwords, and their stored hashes |
//! | [`single_sign_on`] | what an account at a provider means here: role, name, login |
//! | [`password_state`] | who chose a password, and who must change it |
//! | [`centre`] | the centre's logo |
//! | [`certificate`] | certificates: what they say, their states, keys and signatures |
//! | [`box_agent`] | the agent that stands by at a box: its state, its messages, PINs |
//! | [`boxes`] | a box trainer: its camera's viewpoint and its tools |
//! | [`trainee`] | level and handedness |
//! | [`consent`] | consent to recordings: texts, decisions, the rule for new recordings |
//! | [`personal_retention`] | how long the videos of one trainee are kept |
//! | [`access`] | what people open of the recordings of others |
//! | [`enrolment`] | a list of trainees to enrol, checked row by row |
//! | [`task`] | an exercise's description |
//! | [`feature`] | the list of features, and the key of one of them |
//! | [`hand`] | the hand that a limit is for, and the tools in a session's hands |
//! | [`evidence`] | the seconds of a recording that made a session's features |
//! | [`advice`] | what to work on next, by rules |
//! | [`rating`] | rating forms, and instructors' marks on them |
//! | [`error_sheet`] | errors that raters count, and the score formula that weighs them |
//! | [`clock`] | the time of a recording's frames, and how it is corrected |
//! | [`comment`] | comments on a moment or a stretch of a session |
//! | [`edit`] | edits of a scored session: trim, swap, set aside |
//! | [`exam`] | exams: states, judgement of an attempt, result |
//! | [`standard`] | a task's requirements: targets, pass rule, charts |
//! | [`cohort`] | members of a reference group |
//! | [`course`] | a course plan: steps, each with a task |
//! | [`calibration`] | a version of a box's camera |
//! | [`camera_limits`] | numbers that no camera has |
//! | [`camera_warning`] | what makes a camera doubtful |
//! | [`photo_check`] | whether one photo of a checkerboard is usable |
//! | [`name_matcher`] | trainees, tasks and boxes in the names of files and folders |
//! | [`palette`] | a version of a box's colour samples |
//! | [`self_test`] | results of a box's self-test |
//! | [`blob`] | files named by their content |
//! | [`job`] | kinds, states and inputs of jobs |
//! | [`feed`] | frames that arrive during the recording: records, messages, frame numbers |
//! | [`record_merge`] | merging two records of one person or box |
//! | [`rescoring`] | scoring sessions again: the order, and what changed |
//! | [`session`] | states of a recording, versions and features of its result |
//! | [`session_cut`] | cutting a recording with two attempts into two sessions |
//! | [`session_move`] | moving a session to the right trainee, task or box |
//! | [`skill`] | a model of skill: as stored, as shown, and as a file |
//! | [`waiting_recording`] | recordings that wait for a name |
//! | [`xapi`] | sessions as statements for learning record stores |
//! | [`problem`] | why something failed, for people |
//! | [`files`] | exchange formats: camera.json, annotations.json, trajectories, features, truth |

pub mod access;
pub mod advice;
pub mod attention;
pub mod blob;
pub mod box_agent;
pub mod boxes;
pub mod calibration;
pub mod camera_limits;
pub mod camera_warning;
pub mod centre;
pub mod certificate;
pub mod clock;
pub mod cohort;
pub mod comment;
pub mod consent;
pub mod course;
pub mod edit;
pub mod enrolment;
pub mod erasure;
pub mod error_sheet;
pub mod evidence;
pub mod exam;
pub mod feature;
pub mod feed;
pub mod files;
pub mod hand;
pub mod job;
pub mod name_matcher;
pub mod palette;
pub mod password_state;
pub mod personal_retention;
pub mod photo_check;
pub mod problem;
pub mod rating;
pub mod record_merge;
pub mod rescoring;
pub mod rights;
pub mod role;
pub mod scope;
pub mod secret;
pub mod self_test;
pub mod session;
pub mod session_cut;
pub mod session_move;
pub mod single_sign_on;
pub mod skill;
pub mod standard;
pub mod task;
pub mod text;
pub mod token_expiry;
pub mod trainee;
pub mod waiting_recording;
pub mod xapi;

/// Defines an enumeration whose variants have one name each, used in files, the API and the database alike.
///
/// A name is matched as `tt`: the API description would not see the name behind a `literal` and list the variant.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident: $what:literal { $($(#[$variant_doc:meta])* $variant:ident = $text:tt,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
        pub enum $name { $($(#[$variant_doc])* #[serde(rename = $text)] $variant,)* }

        impl $name {
            /// All values.
            pub const ALL: &[$name] = &[$($name::$variant),*];

            /// The value's name in files, the API and the database.
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
