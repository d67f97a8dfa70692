// The languages against each other, without a browser: the same keys, kinds and parameters everywhere, nothing left in English,
// no function that says `undefined`. And against the service: every code that it says has its words.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { test } from 'node:test';

import de from '../../static/texts/de.js';
import en from '../../static/texts/en.js';

const source = path => readFileSync(new URL(`../../src/${path}`, import.meta.url), 'utf8');
/** The service's own files, without what tests it. */
const sources = readdirSync(new URL('../../src', import.meta.url), { recursive: true })
  .filter(name => name.endsWith('.rs') && !/(^|\/)tests(\/|\.rs$)/.test(name))
  .map(name => [name, source(name).split(/#\[cfg\(test\)\]\s+mod \w+ \{/)[0]]);

/** Names, signs, units and words that are German, too. */
const ALIKE = new Set([
  'product', 'nav.wall', 'live.open', 'account.name', 'sessions.status', 'target.box', 'sessions.box', 'session.box',
  'session.show.mask', 'session.spans.20', 'session.spans.5', 'session.clock', 'session.x', 'session.y', 'session.z',
  'session.speed', 'session.slow', 'session.fast', 'session.off', 'session.toldLive', 'session.formats.csv',
  'session.formats.json', 'session.formats.parquet', 'session.portShift', 'session.noise', 'session.title',
  'session.edits.asideBy', 'session.ratings.anchor', 'session.pause', 'watch.line.live', 'watch.spoken', 'wall.title',
  'trainees.name', 'tasks.name', 'boxes.name', 'boxes.calibrated', 'box.annotations', 'box.hand', 'box.version',
  'setup.numbered', 'setup.tools.numbered', 'setup.tools.name', 'setup.colours.zoom', 'setup.agent.secret', 'people.name',
  'report.brand', 'report.box', 'report.sha256', 'report.standard', 'task.version', 'task.share', 'standardForm.cohortOf',
  'rescoring.orderOf', 'rescoring.was', 'groups.state', 'groups.name', 'groups.noStandard', 'enrol.columns.name',
  'cohorts.name', 'courses.of', 'balance.of', 'certificate.standard', 'form.optional', 'units.none', 'watch.because',
  'standardForm.presetOf', 'today.announce', 'upload.announce', 'target.forWhom', 'record.keptHere', 'selfTest.partLight',
  'selfTest.dayLight', 'trainee.point', 'trainee.judgements.plain',
]);
/** Lists that each language has of its own length. */
const OF_ANY_LENGTH = ['enrol.headers.'];
/** What a function is given where a few numbers will not do. */
const GIVEN = {
  'balance.of': ['Duration', 'red'],
  'box.advice.and': [['red', 'blue']],
  'box.advice.best': [['red', 'blue']],
  'box.readyBut': [['red', 'blue']],
  'enrol.unknownColumns': [['Shoe size']],
  'record.unheld': [['exposureMode', 'whiteBalanceMode']],
  'session.comments.withdrawThis': ['a comment'],
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

/** Every leaf of a tree of words as `[path, value]`. */
function* leaves(value, path = '') {
  if (kind(value) !== 'object' && kind(value) !== 'list') return yield [path, value];
  for (const [key, inner] of Object.entries(value)) yield* leaves(inner, path ? `${path}.${key}` : key);
}

/** What keeps two trees from being of one shape. */
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

/** What a function says of none, one and several. */
const calls = (path, say) => (GIVEN[path] ? [say(...GIVEN[path])] : [0, 1, 3].map(n => say(...Array(say.length).fill(n))));
const sayings = (path, value) => (kind(value) === 'function' ? calls(path, value) : [value]);

test('the languages have the same keys, of the same kinds, with the same parameters', () => {
  assert.deepEqual([...differences(pages, german)], []);
  assert.deepEqual(Object.keys(theirs), [], 'the service speaks English by itself');
});

test('nothing is left in English that is not German, too', () => {
  const english = new Map(leaves(pages));
  const same = [...leaves(german)].filter(([path, value]) => {
    const [own, its] = [sayings(path, value), sayings(path, english.get(path))];
    return own.some((text, at) => text === its[at]);
  });
  const isAlike = path => ALIKE.has(path) || OF_ANY_LENGTH.some(begin => path.startsWith(begin));
  assert.deepEqual(same.map(([path, value]) => `${path}: ${value}`).filter(line => !isAlike(line.split(':')[0])), []);
  const needless = [...ALIKE].filter(path => !same.some(([other]) => other === path));
  assert.deepEqual(needless, [], 'these differ, and are listed as alike');
});

for (const [name, words] of Object.entries({ English: pages, German: german }))
  test(`whatever ${name} says, it is words`, () => {
    for (const [path, value] of leaves(words))
      for (const text of sayings(path, value)) {
        assert.equal(typeof text, 'string', path);
        assert.doesNotMatch(text, /undefined|NaN|\[object|=>|null/, path);
        if (path !== 'units.none' && path !== 'trainee.judgements.plain' && path !== 'trainee.point') assert.notEqual(text, '', path);
      }
  });

/** What the words of the service's codes make of figures. */
const SAID = {
  findings: [0.123, 0.5],
  nearest: ['background'],
  problems: [{ field: 'trainee', limit: 5, limit_bytes: 2_000_000, reason: 'too_few_people', missing: { novice: 3, intermediate: 0, expert: 1 } }],
  selfTest: [{ light: 'green', figure: 0.123 }, { accuracy: { touches: 6, rms_mm: 1, along_rms_mm: 1, across_rms_mm: 1, largest_mm: 2 },
    holds: [{ not_counted: null }, { not_counted: 'board_moved' }], focal_change_percent: 0.1, focal_sigma_percent: 0.1 }],
};
function* everyGerman() {
  for (const [path, value] of leaves(german)) for (const text of sayings(path, value)) yield [path, text];
  for (const [path, value] of leaves(said))
    for (const text of [kind(value) === 'function' ? value(...SAID[path.split('.')[0]]) : value].flat()) yield [`said.${path}`, text];
}

test('German is written as German is, and so is what it says by the service’s codes', () => {
  for (const [path, text] of everyGerman()) {
    assert.equal(typeof text, 'string', path);
    assert.doesNotMatch(text, /undefined|NaN|\[object|=>/, path);
    assert.doesNotMatch(text, /"|'|’|\.\.\.| - /, path);
    assert.equal(text.split('„').length, text.split('“').length, `${path}: ${text}`);
  }
});

test('every code that the service says has German words', () => {
  const named = (text, pattern) => [...text.matchAll(pattern)].map(([, name]) => name);
  const folder = 'pipeline/features/';
  const files = readdirSync(new URL(`../../src/${folder}`, import.meta.url)).filter(name => name.endsWith('.rs'));
  const features = files.flatMap(name => named(source(folder + name).split('#[cfg(test)]')[0], /^    name: "([a-z_0-9]+)",$/gm));
  const lists = {
    features,
    exercises: named(source('pipeline/score/standard/fls.rs'), /^    preset\("([a-z_]+)"/gm),
    items: named(source('domain/rating/forms.rs'), /^        "([a-z_]+)",$/gm),
    findings: named(source('pipeline/quality/cause.rs').split('pub fn unit')[0], /^            Cause::[A-Za-z]+ => "([a-z_]+)",$/gm),
    withheld: named(source('pipeline/score/no_answer.rs'), /NoAnswer::[A-Za-z]+(?: \{ \.\. \})? => "([a-z_]+)"/g),
    problems: [
      ...named(source('http/error.rs'), /^    \(Refusal::[A-Za-z]+, "([a-z-]+)"/gm),
      ...named(source('analysis/child/explain.rs'), /"([a-z]+(?:-[a-z]+)+)"/g),
      ...named(source('domain/problem.rs'), /: &'static str = "([a-z-]+)"/g),
      ...sources.flatMap(([, text]) => named(text, /\bProblem::new\(\s*"([a-z-]+)"/g)),
    ],
  };
  const otherwise = sources.filter(([, text]) => /\bProblem::new\((?!\s*(?:"|Problem::))/.test(text)).map(([name]) => name);
  assert.deepEqual(otherwise, ['analysis/child/explain.rs'], 'codes that are not read here');
  for (const [kindOf, codes] of Object.entries(lists)) {
    assert.ok(codes.length >= 5, `${kindOf}: ${codes.length} found in the source`);
    assert.deepEqual(codes.filter(code => !(code in said[kindOf])), [], `${kindOf} without words`);
  }
});
