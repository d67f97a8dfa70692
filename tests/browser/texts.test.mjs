// Compares the languages of the pages without a browser: the same keys, types and parameters, no text left in English,
// no function that returns `undefined`. Also checks that every code of the service has a German text.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { test } from 'node:test';

import de from '../../static/texts/de.js';
import en from '../../static/texts/en.js';
import { BOX_REFUSALS, CONFLICTS, findSentence } from '../../static/conflicts.js';
import { INVALID_VALUES } from '../../static/invalid_values.js';
import { boxRefusals, conflictSentences } from './conflict_sentences.mjs';

const source = path => readFileSync(new URL(`../../${path}`, import.meta.url), 'utf8');
/** The source files of the service and its science, without their tests. */
const sources = ['src', 'measurement/src'].flatMap(folder =>
  readdirSync(new URL(`../../${folder}`, import.meta.url), { recursive: true }).map(name => `${folder}/${name}`))
  .filter(name => name.endsWith('.rs') && !/\/tests(\/|\.rs$)/.test(name))
  .map(name => [name, source(name).split(/#\[cfg\(test\)\]\s+mod \w+ \{/)[0]]);

/** Texts that are the same in English and German: names, signs, units and shared words. */
const SAME_IN_BOTH = new Set([
  'merges.part', 'merges.merged', 'boxAgent.seconds', 'boxScreen.start', 'boxScreen.pin', 'certificates.about', 'verify.person', 'verify.standard',
  'product', 'exams.standard', 'nav.wall', 'live.open', 'account.name', 'target.box', 'sessions.box', 'session.box',
  'session.spans.20', 'session.spans.5', 'session.clock', 'session.x', 'session.y', 'session.z',
  'session.speed', 'session.slow', 'session.fast', 'session.off', 'session.toldLive', 'session.formats.csv',
  'session.formats.json', 'session.formats.parquet', 'session.portShift', 'session.noise', 'session.title',
  'session.edits.asideBy', 'session.ratings.anchor', 'session.pause', 'watch.line.live', 'watch.spoken', 'wall.title',
  'trainees.name', 'tasks.name', 'boxes.name', 'boxes.calibrated', 'box.annotations', 'box.hand', 'box.version',
  'setup.numbered', 'setup.tools.numbered', 'setup.tools.name', 'setup.colours.zoom', 'setup.agent.secret', 'people.name', 'invitations.name', 'invitations.link',
  'report.box', 'report.sha256', 'report.standard', 'task.version', 'task.share', 'standardForm.cohortOf',
  'rescoring.orderOf', 'rescoring.was', 'groups.state', 'groups.name', 'groups.noStandard', 'enrol.columns.name',
  'cohorts.name', 'courses.of', 'balance.of', 'certificate.standard', 'background.other', 'form.optional', 'units.none', 'watch.because',
  'standardForm.presetOf', 'today.announce', 'upload.announce', 'target.forWhom', 'record.keptHere', 'selfTest.partLight',
  'errors.icc', 'errors.name', 'box.versions.version', 'selfTest.dayLight', 'trainee.point', 'feedback.on', 'trainee.judgements.plain',
]);
/** Lists whose length may differ between the languages. */
const OF_ANY_LENGTH = ['enrol.headers.'];
/** Arguments for text functions that need more than a few numbers. */
const ARGUMENTS = {
  'balance.of': ['Duration', 'red'],
  'box.advice.and': [['red', 'blue']],
  'box.advice.best': [['red', 'blue']],
  'box.readyBut': [['red', 'blue']],
  'enrol.unknownColumns': [['Shoe size']],
  'record.unheld': [['exposureMode', 'whiteBalanceMode']],
  'session.comments.deleteThis': ['a comment'],
  'session.comments.withdrawThis': ['a comment'],
  'errors.untyped': [['Deviation from the line']],
  'exams.givenBack': [[1, 2]],
  'exams.used': [1, 2, [1]],
  'feedback.by': [['Ines', 'Omar']],
  'session.rateOf': [0.5],
  'session.edits.does.swap': ['0:01–0:02', ['red', 'blue']],
  'session.edits.says.swap': ['0:01–0:02', ['red', 'blue']],
  'session.skill.all': [['a', 'b']],
  'setup.board.onSheet': [{ columns: 9, rows: 6 }, 21.5, 150],
  'setup.board.sheet': [{ columns: 9, rows: 6 }],
  'setup.calibration.boardOf': ['9x6', 21.5],
  'setup.calibration.with': [3, 4, '9x6', 21.5],
  'setup.colours.unmarked': [['red', 'blue']],
  'setup.photos.heard': [{ name: 'one', check: { found: true } }],
  'setup.photos.hint': ['cut_off', ['left', 'top']],
  'setup.photos.missing': [[['top', 'left'], ['middle', 'middle'], ['middle', 'right'], ['bottom', 'middle']]],
  'setup.photos.untilted': [['left', 'top']],
  'setup.photos.verdict': [{ state: 'checked', check: { found: true, corners: [1, 2, 3] } }, false],
  'setup.photos.withBoard': ['9x6', 21.5],
  'setup.tools.known': [['red', 'blue']],
  'task.basis.best_share': [{ percent: '20 %', people: 3 }],
  'task.basis.contrasting_groups': [{ novices: 10, experts: 11 }],
  'task.basis.external': [{ source: 'a book' }],
  'task.basis.trimmed_experts': [{ experts: 10, dropped: 2 }],
  'task.design': [{ inadequate: '20 %', adequate: '5 %', within: 30, wrong: '5 %' }],
  'watch.because': ['so it is'],
};

const kind = value => (Array.isArray(value) ? 'list' : value === null ? 'null' : typeof value);
const { said: theirs, ...pages } = en;
const { said, ...german } = de;

/** Every leaf of a tree of texts as `[path, value]`. */
function* leaves(value, path = '') {
  if (kind(value) !== 'object' && kind(value) !== 'list') return yield [path, value];
  for (const [key, inner] of Object.entries(value)) yield* leaves(inner, path ? `${path}.${key}` : key);
}

/** The differences in shape between two trees of texts, one string each. */
function* differences(one, other, path = '') {
  if (kind(one) !== kind(other)) return yield `${path}: ${kind(one)} here, ${kind(other)} there`;
  if (kind(one) === 'function' && one.length !== other.length) yield `${path}: ${one.length} parameters here, ${other.length} there`;
  if (kind(one) !== 'object' && kind(one) !== 'list') return;
  if (kind(one) === 'list' && OF_ANY_LENGTH.some(begin => path.startsWith(begin))) return;
  for (const key of new Set([...Object.keys(one), ...Object.keys(other)])) {
    const at = path ? `${path}.${key}` : key;
    if (key in one && key in other) yield* differences(one[key], other[key], at);
    else yield `${at}: only ${key in one ? 'here' : 'there'}`;
  }
}

/** The texts of a function for 0, 1 and 3, or for its arguments in `ARGUMENTS`. */
const callWithArguments = (path, say) => (ARGUMENTS[path] ? [say(...ARGUMENTS[path])] : [0, 1, 3].map(n => say(...Array(say.length).fill(n))));
const textsOf = (path, value) => (kind(value) === 'function' ? callWithArguments(path, value) : [value]);

test('the languages have the same keys, with the same types and parameters', () => {
  assert.deepEqual([...differences(pages, german)], []);
  assert.deepEqual(Object.keys(theirs), ['invalid'], 'the service answers in English: only its sentences on values are for programs');
});

test('no German text equals the English one, except those listed', () => {
  const english = new Map(leaves(pages));
  const same = [...leaves(german)].filter(([path, value]) => {
    const [own, its] = [textsOf(path, value), textsOf(path, english.get(path))];
    return own.some((text, at) => text === its[at]);
  });
  const isSameInBoth = path => SAME_IN_BOTH.has(path) || OF_ANY_LENGTH.some(begin => path.startsWith(begin));
  assert.deepEqual(same.filter(([path]) => !isSameInBoth(path)).map(([path, value]) => `${path}: ${value}`), []);
  const needless = [...SAME_IN_BOTH].filter(path => !same.some(([other]) => other === path));
  assert.deepEqual(needless, [], 'listed as the same in both languages, but they differ');
});

for (const [name, words] of Object.entries({ English: pages, German: german }))
  test(`every ${name} text is a string without undefined, NaN or null, and not empty`, () => {
    for (const [path, value] of leaves(words))
      for (const text of textsOf(path, value)) {
        assert.equal(typeof text, 'string', path);
        assert.doesNotMatch(text, /undefined|NaN|\[object|=>|null/, path);
        if (path !== 'units.none' && path !== 'trainee.judgements.plain' && path !== 'trainee.point') assert.notEqual(text, '', path);
      }
  });

/** Arguments for the text functions of the service's codes. */
const CODE_ARGUMENTS = {
  findings: [0.123, 0.5],
  notEnough: [0.5, 2],
  nearest: ['background'],
  longest: [{ from_s: 2.2, to_s: 6, to_end: true }],
  rows: [{ from_frame: 9, from_s: 0.3, to_frame: 10, to_s: 0.3333 }],
  moment: [83.2],
  invalid: ['12', '3', '40'],
  conflicts: ['12', '3', '40', '7'],
  problems: [{ field: 'trainee', consent: 'missing', wait_s: 5, limit_bytes: 2_000_000, reason: 'too_few_people', missing: { novice: 3, intermediate: 0, expert: 1 } }],
  colours: [{ share: 0.123, label: 'background', light: '30 % darker', frame: 7, at: [1, 2], steps: [1.23, 4.56], largest_of_band: 0.7 }],
  selfTest: [{ light: 'green', figure: 0.123 }, { accuracy: { touches: 6, rms_mm: 1, along_rms_mm: 1, across_rms_mm: 1, largest_mm: 2 },
    holds: [{ not_counted: null }, { not_counted: 'board_moved' }], focal_change_percent: 0.1, focal_sigma_percent: 0.1 }],
};
function* everyGerman() {
  for (const [path, value] of leaves(german)) for (const text of textsOf(path, value)) yield [path, text];
  for (const [path, value] of leaves(said))
    for (const text of [kind(value) === 'function' ? value(...CODE_ARGUMENTS[path.split('.')[0]]) : value].flat()) yield [`said.${path}`, text];
}

test('German texts use German quotation marks, dashes and ellipses', () => {
  for (const [path, text] of everyGerman()) {
    assert.equal(typeof text, 'string', path);
    assert.doesNotMatch(text, /undefined|NaN|\[object|=>/, path);
    assert.doesNotMatch(text, /"|'|’|\.\.\.| - /, path);
    assert.equal(text.split('„').length, text.split('“').length, `${path}: ${text}`);
  }
});

test('every reason for a missing position has words in both languages', () => {
  const names = [...source('measurement/src/vision/reason.rs').matchAll(/^            MissReason::[A-Za-z]+ => "([a-z_]+)",$/gm)].map(([, name]) => name);
  assert.ok(names.length >= 17, `${names.length} reasons found in the source`);
  for (const texts of [en, de]) assert.deepEqual(names.filter(name => !(name in texts.session.reasons)), []);
});

/** The source of the features, without tests. */
const featureSource = sources.filter(([name]) => /^measurement\/src\/motion\/features\/\w+\.rs$/.test(name)).map(([, text]) => text).join('\n');

test('a German title of a feature has the numbers of the English one', () => {
  const titles = [...featureSource.matchAll(/^    name: "([a-z_0-9]+)",\n    title: "([^"]+)",$/gm)];
  assert.ok(titles.length > 40, `${titles.length} titles found in the source`);
  const numbers = text => text.match(/\d+/g) ?? [];
  for (const [, name, title] of titles) assert.deepEqual(numbers(said.features[name]), numbers(title), name);
});

test('every code of the service has a German text', () => {
  const named = (text, pattern) => [...text.matchAll(pattern)].map(([, name]) => name);
  const lists = {
    features: named(featureSource, /^    name: "([a-z_0-9]+)",$/gm),
    rules: named(source('measurement/src/motion/features/habit.rs'), /^            Habit::[A-Za-z]+ => "([a-z_]+)",$/gm),
    noAdvice: named(source('src/http/sessions/evidence.rs'), /\breason: "([a-z_]+)"/g),
    exercises: named(source('measurement/src/statistics/standard/fls.rs'), /^    preset\("([a-z_]+)"/gm),
    items: named(source('src/domain/rating/forms.rs'), /^        "([a-z_]+)",$/gm),
    findings: named(source('measurement/src/motion/quality/cause.rs').split('pub fn unit')[0], /^            QualityCause::[A-Za-z]+ => "([a-z_]+)",$/gm),
    notEnough: named(source('measurement/src/motion/features/not_enough.rs'), /^    \("([a-z_]+)", "/gm),
    selfTestAdvice: named(source('measurement/src/checks/self_test/advice.rs'), /^            SelfTestAdvice::[A-Za-z]+ => "([a-z_]+)",$/gm),
    colours: named(source('src/domain/palette.rs').split('ColourFault:')[1].split('pub struct')[0], /^        [A-Za-z]+ = "([a-z_]+)",$/gm),
    withheld: named(source('measurement/src/statistics/no_answer.rs'), /NoAnswer::[A-Za-z]+(?: \{ \.\. \})? => "([a-z_]+)"/g),
    problems: [
      ...named(source('src/http/error.rs'), /^    \(Refusal::[A-Za-z]+, "([a-z-]+)"/gm),
      ...named(source('src/analysis/child/explain.rs'), /"([a-z]+(?:-[a-z]+)+)"/g),
      ...named(source('src/domain/problem.rs'), /: &'static str = "([a-z-]+)"/g),
      ...sources.flatMap(([, text]) => named(text, /\bProblem::new\(\s*"([a-z-]+)"/g)),
    ],
  };
  const unread = sources.filter(([, text]) => /\bProblem::new\((?!\s*(?:"|Problem::))/.test(text)).map(([name]) => name);
  assert.deepEqual(unread, ['src/analysis/child/explain.rs'], 'files with problem codes that this test does not read');
  for (const [kindOf, codes] of Object.entries(lists)) {
    assert.ok(codes.length >= 5, `${kindOf}: ${codes.length} found in the source`);
    assert.deepEqual(codes.filter(code => !(code in said[kindOf])), [], `${kindOf} without a German text`);
  }
});

test('what the service says about a field has a German sentence, which is the first that fits', () => {
  for (const [message, expected] of [
    ['has 0 characters; expected 1 to 120', /ausfüllen/],
    ['name: has 130 characters; expected 1 to 120.', /130 Zeichen/],
    ['login: expected only a–z 0–9 . _ - @ +.', /ohne Leerzeichen/],
    ['expected only a–z 0–9 and dashes', /Bindestriche/],
    ['is 50; expected 1 to 30 frames a second', /50 Bilder je Sekunde/],
    ['is 0; expected 1 to 200', /erlaubt sind 1 bis 200/],
    ['expected one of novice intermediate expert', /: novice, intermediate, expert\.$/],
    ['unknown variant `x`, expected one of `a`, `b`, `c` at line 1 column 9', /: a, b, c\.$/],
    ['is missing; send the recording', /fehlt/],
    ['missing field `name` at line 1 column 2', /fehlt/],
  ]) {
    const [name, pattern] = INVALID_VALUES.find(([, one]) => one.test(message));
    assert.match(said.invalid[name](...message.match(pattern).slice(1)), expected, message);
  }
  const names = INVALID_VALUES.map(([name]) => name);
  for (const texts of [said, theirs]) assert.deepEqual(Object.keys(texts.invalid), names);
});

const TO_SENDERS = 'it closes the connection of a sender of frames';
/** Sentences that no page shows, and why. */
const NEVER_SHOWN = {
  'It would have the address {} for ever, which can be opened {}. An administrator can set the right address: `public_url` under `[http]` in the settings file, which is trocar.toml in the data folder unless the service was started with another one. It counts after a restart. If it is to have this address all the same, confirm it with `accept_local_address`.':
    'the page asks in its own words, by `local_address`',
  'Another worker has taken over this job. Read it again.': 'a worker gets it',
  'This result belongs to a job on {}, but the job has none.': 'a worker gets it',
  "A session's job is made with the session.": 'no route enqueues such a job',
  'This was a preview.': 'the store catches it',
  "The folder's name is not UTF-8.": 'the start of the service fails with it',
  '`{}` in the list of erasures is not an id.': 'a restore fails with it',
  'The upload has {} bytes. Ask for the offset with HEAD, and continue from there.': 'a tus client continues by itself',
  '{} of {} bytes have arrived: send the rest first.': 'a tus client sends the rest first',
  'This cursor is of another list: begin with the first page.': 'the pages use a cursor with its own list',
  'An imported session has only one path. Request it with `kind=smoothed`.': 'the pages request the path that there is',
  'There is no such {}.': TO_SENDERS,
  'The box is sending another recording ({}): end that one, or stop its sender.': TO_SENDERS,
  'The recording is being assembled: connect again.': TO_SENDERS,
  'Another connection sends this recording now.': TO_SENDERS,
  'A later connection of the agent.': TO_SENDERS,
  'The session was erased: a new recording needs a new id.': TO_SENDERS,
  'This recording was erased: start a new recording with a new id.': TO_SENDERS,
  'This recording was begun with another box, trainee, task, codec, size or time base: start a new recording with a new id.': TO_SENDERS,
  '{} {} unfinished recordings: end them, or wait until they end by themselves.': TO_SENDERS,
  'You are sending as many recordings at once as are allowed. End one of them, then try again.': TO_SENDERS,
  'Too many agents stand by with this token, or in all. Stop the others.': 'an agent gets it',
  'There were too many failed attempts. Try again in {} s.': 'the pages say it by `wait_s`',
  'There were too many failed attempts to sign in. Try again in {} s. A browser that has signed in to the account before does not wait for the attempts of others, and a link for a new password, from an administrator, works at once.': 'the pages say it by `sign_in_wait_s`',
  'This recording was ordered for an exam of another candidate, task or box, or for another sender.': TO_SENDERS,
  'The exam takes this recording no more: it has ended, its attempts are used, or the attempt was started anew. Look at the page of the exam.': TO_SENDERS,
};
/** Calls that pass on a sentence of another place. */
const PASSED_ON = [
  'src/http/certificates/mod.rs: format!("{}.", super::error::capitalised(&error))', // The sentences of `IssueError`, which are read.
  'src/http/error.rs: format!("{}.", capitalised(&error))', // Those of the store, which are read.
  "src/http/error.rs: format!(\"{}.\", capitalised(&why.trim_end_matches('.')))", // Those of limits of senders, which are read.
  'src/http/error.rs: format!("{}.", capitalised(detail))', // The pages translate it by its `reason`.
  'src/http/sessions/files.rs: sentence(&deleted)', // That of `video_deleted`, which is read.
  'src/store/edits.rs: invalid.to_string()', // A constant that is valid.
  'src/store/palettes.rs: error.to_string()', // The handler has checked the sizes, and answers `invalid`.
  'src/store/sessions/write.rs: dropped', // That of `video_deleted`, which is read.
];
const conflicts = conflictSentences(sources);
const shownSentences = conflicts.sentences.filter(sentence => !(sentence in NEVER_SHOWN));
/** The sentence that a program would get, with a text for each `{}`. */
const filled = sentence => sentence.replaceAll('{}', () => 'Some 3');

test('every sentence about what is not possible now has a German text, which gets what the service inserts', () => {
  assert.ok(shownSentences.length >= 140, `${shownSentences.length} sentences found in the source`);
  assert.deepEqual(shownSentences.filter(sentence => !findSentence(CONFLICTS, filled(sentence))), [], 'static/conflicts.js lacks these');
  for (const sentence of shownSentences) {
    const { name, captured } = findSentence(CONFLICTS, filled(sentence));
    assert.deepEqual(captured, sentence.split('{}').slice(1).map(() => 'Some 3'), sentence);
    assert.equal(said.conflicts[name]?.length, captured.length, `${name}: parameters of the German text`);
  }
});

test('the sentences about what is not possible now are all in the sources, each once, and each is read there', () => {
  const all = CONFLICTS.flatMap(([, ...sentences]) => sentences);
  assert.deepEqual(all.filter(sentence => !shownSentences.includes(sentence)), [], 'static/conflicts.js has these, the service has not');
  assert.deepEqual(all.filter((sentence, at) => all.indexOf(sentence) !== at), []);
  assert.deepEqual(Object.keys(said.conflicts), CONFLICTS.map(([name]) => name));
  assert.deepEqual(Object.keys(NEVER_SHOWN).filter(sentence => !conflicts.sentences.includes(sentence)), [], 'no longer in the source');
  assert.deepEqual(conflicts.unread.sort(), PASSED_ON, 'calls with a sentence that this test does not read');
  const otherwise = /\bRefusal::(?:Conflict|Gone|TooMany)\b(?!\s*\.with\()|\bStoreError::Refused \{ why:/;
  assert.deepEqual(sources.filter(([, text]) => otherwise.test(text)).map(([name]) => name).sort(), ['src/http/error.rs', 'src/store/error.rs']);
});

test('what the agent of a box refuses has a text for the screen of the box and for the pages', () => {
  const refusals = boxRefusals(source('src/capture/standby/refusal.rs'));
  assert.deepEqual(BOX_REFUSALS, refusals);
  assert.ok(refusals.length >= 14, `${refusals.length} refusals found in the source`);
  for (const texts of [en, de]) assert.deepEqual(Object.keys(texts.boxScreen.refusedFor), refusals.map(([kindOf]) => kindOf));
  assert.equal(findSentence(BOX_REFUSALS, findSentence(CONFLICTS, 'The box refused: no recording is running.').captured[0]).name, 'not-running');
});
