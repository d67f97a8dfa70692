//! Finds trainees, tasks and boxes in the names of files and folders. What it finds is a proposal that a person
//! confirms.
//!
//! A code or name is found if all its words stand side by side in the name of the file or of one folder, in any case:
//! `ada_novak-peg 3.mp4` has `Ada Novak`. A name of two words is found in both orders. If the names speak for two
//! different people, nothing is proposed: a wrong proposal is worse than none, because it may be confirmed unseen.

/// The things that may be named, by their place in the list that they came from.
#[derive(Clone, Debug, Default)]
pub struct NameMatcher {
    forms: Vec<NameForm>,
}

/// One way to write a thing.
#[derive(Clone, Debug)]
struct NameForm {
    index: usize,
    words: Vec<String>,
}

/// Where a form stands: the part of the path, and its words there.
struct Found<'f> {
    form: &'f NameForm,
    part: usize,
    start: usize,
}

impl NameMatcher {
    /// The matcher of these codes and names.
    pub fn new<'n>(things: impl IntoIterator<Item = (&'n str, &'n str)>) -> Self {
        let mut forms = Vec::new();
        for (index, (code, name)) in things.into_iter().enumerate() {
            let name = words(name);
            let reversed = if name.len() == 2 { name.iter().rev().cloned().collect() } else { Vec::new() };
            for words in [words(code), name, reversed] {
                if is_distinctive(&words) {
                    forms.push(NameForm { index, words });
                }
            }
        }
        Self { forms }
    }

    /// The place of the only thing that these names speak of: those of folders and of the file.
    pub fn find(&self, names: &[&str]) -> Option<usize> {
        let parts: Vec<Vec<String>> = names.iter().map(|name| words(name)).collect();
        let found: Vec<Found<'_>> = self.forms.iter().flat_map(|form| find_in(form, &parts)).collect();
        let mut widest = found.iter().filter(|one| !found.iter().any(|other| other.surrounds(one)));
        let index = widest.next()?.form.index;
        widest.all(|one| one.form.index == index).then_some(index)
    }
}

impl Found<'_> {
    fn end(&self) -> usize {
        self.start + self.form.words.len()
    }

    /// True if the other stands inside this one, which has more words.
    fn surrounds(&self, other: &Found<'_>) -> bool {
        self.part == other.part
            && self.start <= other.start
            && other.end() <= self.end()
            && self.form.words.len() > other.form.words.len()
    }
}

fn find_in<'f>(form: &'f NameForm, parts: &[Vec<String>]) -> Vec<Found<'f>> {
    let places = |(part, words): (usize, &Vec<String>)| {
        let starts = words.windows(form.words.len()).enumerate().filter(|(_, run)| *run == form.words.as_slice());
        starts.map(move |(start, _)| Found { form, part, start }).collect::<Vec<_>>()
    };
    parts.iter().enumerate().flat_map(places).collect()
}

/// Numbers and single letters stand in many names without a meaning.
fn is_distinctive(words: &[String]) -> bool {
    let letters = words.iter().flat_map(|word| word.chars()).filter(|c| c.is_alphabetic()).count();
    let characters: usize = words.iter().map(|word| word.chars().count()).sum();
    letters >= 2 || letters == 1 && characters >= 3 // such as p-12
}

/// The words of a text in small letters, with German umlauts spelled out.
fn words(text: &str) -> Vec<String> {
    let spelled = text.to_lowercase().replace('ä', "ae").replace('ö', "oe").replace('ü', "ue").replace('ß', "ss");
    spelled.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_person_is_found_and_two_are_not_guessed_between() {
        let people =
            [("ada-novak", "Ada Novak"), ("ada", "Ada"), ("bob-ray", "Bob Ray"), ("p-12", "Jörg Weiß"), ("7", "Li")];
        let matcher = NameMatcher::new(people);
        for (names, expected) in [
            (vec!["ada-novak", "1.mp4"], Some(0)),
            (vec!["2024", "Novak_Ada 3.mp4"], Some(0)),
            (vec!["ada.mp4"], Some(1)),
            (vec!["ADA NOVAK", "ada-novak.mp4"], Some(0)),
            (vec!["ada-novak", "bob-ray.mp4"], None),
            (vec!["ada-novak", "ada.mp4"], None),
            (vec!["P-12_peg.mp4"], Some(3)),
            (vec!["joerg weiss.mp4"], Some(3)),
            (vec!["adanovak.mp4"], None),
            (vec!["7.mp4"], None),
            (vec!["li-7.mp4"], Some(4)),
            (vec![], None),
        ] {
            assert_eq!(matcher.find(&names), expected, "{names:?}");
        }
    }
}
