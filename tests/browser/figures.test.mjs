// Every figure that a page shows equals the value in REST. The test reads a figure from the page by its label, requests
// the value from REST with the same sign-in, and compares both after rounding. The rounding rules are implemented here
// a second time, independently of the pages. Then the test alters a REST answer on its way to the page and expects the
// comparison to fail: otherwise it would compare nothing. Live figures are compared with the last message on the page's
// own socket.
//
// Environment: as person.mjs; the centre needs a scored recording. Optional: TROCAR_TASK (the task whose standard is
// compared; default: the task of the newest scored recording).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { setTimeout as pause } from 'node:timers/promises';

import { launch } from './chromium.mjs';
import { person, waitUntil, url } from './person.mjs';
import { beginFeed, endFeed } from './sender.mjs';

const DAY_MS = 86_400_000;

let browser;
let page, create, open;
let cookie;
let session, progress, pass;

/** Requests JSON from REST outside the browser, so that altered routes of the page do not affect it. */
async function getJson(path) {
  const answer = await fetch(`${url}/api/v1/${path}`, { headers: { cookie } });
  assert.ok(answer.ok, `${path}: ${answer.status}`);
  return answer.json();
}

/** Requests all items of a list, page by page. */
async function getAll(path) {
  const items = [];
  for (let cursor = ''; cursor !== null; ) {
    const data = await getJson(`${path}${path.includes('?') ? '&' : '?'}limit=200${cursor && `&cursor=${encodeURIComponent(cursor)}`}`);
    items.push(...data.items);
    cursor = data.next ?? null;
  }
  return items;
}

// How pages write figures.

const plain = value => (Math.abs(value) < 1e20 ? value.toFixed(12).replace(/\.?0+$/, '') : String(value));

/** A true minus, and a comma between thousands. */
function formatted(text) {
  const [whole, rest] = text.replace('-', '−').split('.');
  return whole.replace(/\B(?=(\d{3})+$)/g, ',') + (rest ? `.${rest}` : '');
}

/** Rounds to this many digits after the point, half away from zero, in decimal notation: 4.395 gives 4.40. */
const toDecimals = (value, digits) =>
  (Math.sign(value) * Number(`${Math.round(Number(`${Math.abs(value)}e${digits}`))}e-${digits}`)).toFixed(digits);

/** A value with three significant digits. Whole numbers below 10,000 are counts and stay exact. */
function threeDigits(value) {
  if (value === null || value === undefined) return '–';
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 10_000) return formatted(String(value));
  if (size < 0.1 || size >= 10_000) return formatted(plain(Number(value.toPrecision(3))));
  return formatted(toDecimals(value, size >= 100 ? 0 : size >= 10 ? 1 : 2));
}

/**
 * A value and half its error interval, both rounded to the second significant digit of the half interval. If that digit
 * is not among the first three after the point, the value is written as without an error, and the half interval with
 * two significant digits.
 */
function withError(value, { low, high }) {
  const half = (high - low) / 2;
  const digits = half >= 0.01 && half < 100 ? [100, 10, 1, 0.1].findIndex(size => half >= size / 10) : -1;
  if (digits < 0) return [threeDigits(value), formatted(plain(Number(half.toPrecision(2))))];
  return [toDecimals(value, digits), toDecimals(half, digits)].map(formatted);
}

const percent = share => `${formatted(plain(Number(toDecimals(100 * share, 1))))}%`;
const wholePercent = share => `${Math.round(100 * share)}%`;

/** `1:02.3` */
const clock = (seconds, digits) => {
  const [minutes, rest] = [Math.floor(Number(seconds.toFixed(digits)) / 60), Number(seconds.toFixed(digits)) % 60];
  return `${minutes}:${rest.toFixed(digits).padStart(digits ? digits + 3 : 2, '0')}`;
};

function bytes(count) {
  const step = [1e9, 1e6, 1e3].findIndex(size => count >= size);
  return step < 0 ? `${count} B` : `${(count / [1e9, 1e6, 1e3][step]).toFixed(1)} ${['GB', 'MB', 'kB'][step]}`;
}

/** What the pages write before a value that is only a lower bound. */
const atLeast = point => (point.is_lower_bound ? 'at least ' : '');

/** A report's text for a value without an error bar. */
const withoutBar = point => (point.is_lower_bound ? `at least ${threeDigits(point.value)}` : `${threeDigits(point.value)} (error not known)`);

/** The figures in a sentence, in order, as they are written; the words around them are not compared. */
const figuresIn = text => text.match(/[−-]?\d+(,\d{3})*(\.\d+)?%?/g) ?? [];

// How figures are read from a page.

/** `{ name: value }` of a description list. */
const facts = locator =>
  locator.locator('dt').evaluateAll(names => Object.fromEntries(names.map(name => [name.textContent.trim(), name.nextElementSibling.textContent.trim()])));

/** The text of every cell of a table's body. */
const cells = locator =>
  locator.locator('tbody tr').evaluateAll(rows => rows.map(row => [...row.cells].map(cell => cell.textContent.replace(/\s+/g, ' ').trim())));

/**
 * The feature tables of all folds as `{ 'feature, tool': 'value|not enough|error|limit|place|live value' }`, one entry for each cell.
 */
const featureCells = () =>
  page.locator('.fourth table').evaluateAll(tables => tables.flatMap(table => {
    const own = node => [...node.childNodes].filter(child => child.nodeType === 3).map(child => child.textContent).join('').trim();
    const columns = [...table.tHead.rows[0].cells].slice(1, -1)
      .map(cell => /\((.+)\)$/.exec(cell.textContent)?.[1] ?? cell.textContent.trim()); // The head names hand and tool.
    return [...table.querySelectorAll('tbody tr')].filter(row => row.cells.length === columns.length + 2).flatMap(row =>
      columns.map((column, at) => {
        const cell = row.cells[at + 1];
        const title = own(row.cells[0]) || row.cells[0].querySelector('button').textContent.trim();
        const said = ['.not-enough', '.off', '.limit', '.place', '.told-live'].map(part => cell.querySelector(`:scope > ${part}`)?.textContent.trim() ?? '');
        return [`${title}, ${column}`, [own(cell), ...said].join('|')];
      }));
  })).then(Object.fromEntries);

// The figures of each page, as `[name, text on the page, text expected from REST]`.

/**
 * The expected text about a value's place in the cohort, by feature and tool. It is empty unless this is the trainee's
 * newest counted session. It is also empty if the same reason withholds every place: the page then shows that reason
 * once.
 */
async function placesOf({ id, trainee, task, features, hands, compare_in: compared }) {
  const [cohort] = await getAll('cohorts');
  const places = new Map();
  const reasons = new Set();
  const measured = featuresIn({ features }, compared?.space ?? '3d').filter(one => one.value !== null);
  for (const [feature, of] of new Map(measured.map(one => [one.name, one.space]))) {
    const data = await getJson(`trainees/${trainee.id}/progress?task=${task.id}&feature=${feature}&space=${of}&cohort=${cohort.code}`);
    if (data.sessions.filter(one => !one.set_aside).at(-1)?.id !== id) return places;
    for (const { tool: named, in_hand: hand, place, no_place: withheld } of data.features) {
      const tool = hand ? hands[hand] : named;
      const { value, low, high } = place?.better_than ?? place?.percentile ?? {};
      const said = place && `${place.better_than ? 'better than' : 'above'} ${Math.round(value)} % (${Math.round(low)} – ${Math.round(high)} %)`;
      reasons.add(place ? null : withheld.detail);
      places.set(`${feature} ${tool} ${of}`, said ?? (withheld.missing ? 'no comparison: too few people' : 'no comparison'));
    }
  }
  return reasons.size === 1 && !reasons.has(null) ? new Map() : places;
}

/** The features that the page shows for a space: those without a value in the image are taken from space. */
const featuresIn = ({ features }, space) =>
  features.filter(one => one.space === space || (space === 'image' && !features.some(other => other.name === one.name && other.space === space)));

function featureFigures(of, space, shown, places) {
  const live = new Map((space === '3d' ? (of.live_features ?? []) : []).map(one => [`${one.name} ${one.tool}`, one.value]));
  return featuresIn(of, space).map(one => {
    const what = `${one.title}, ${one.tool ?? 'Both'}`;
    const isKnown = one.value !== null;
    const [value, half] = !isKnown ? ['not enough'] : one.error && !one.no_error ? withError(one.value, one.error) : [threeDigits(one.value)];
    const off = !isKnown ? '' : one.no_error ? '± ?' : half ? `± ${half}` : '';
    const limit = isKnown && one.target ? `at ${one.target.better === 'lower' ? 'most' : 'least'} ${threeDigits(one.target.limit)}` : '';
    const key = `${one.name} ${one.tool}`;
    const liveValue = live.has(key) ? `live ${live.get(key) === null ? 'not enough' : threeDigits(live.get(key))}` : '';
    const place = isKnown ? (places.get(`${key} ${one.space}`) ?? '') : '';
    const [shownValue, missing, error, shownLimit = '', ...rest] = (shown[what] ?? '').split('|');
    return [what, [shownValue || missing, error, shownLimit.split(':')[0], ...rest].join('|'), [value, off, limit, place, liveValue].join('|')];
  });
}

/** The card at the head of a session: its values with their errors, the limits, and the values of the session before. */
async function outcomeFigures(data) {
  const limited = data.features.filter(one => one.target);
  if (!limited.length || data.quality.verdict === 'refused') return [];
  const progress = await getJson(`trainees/${data.trainee.id}/progress?task=${data.task.id}`);
  const number = progress.sessions.find(one => one.id === data.id).number;
  const before = progress.sessions.findLast(one => one.number < number && one.set_aside === null)?.number;
  const withoutUnit = text => text.replace(/ [^\d±]\S*$/, '');
  const text = ({ value, low, high }) => (low === null ? threeDigits(value) : withError(value, { low, high }).join(' ± '));
  const card = page.locator('.outcome-card');
  if (before) await card.getByText('Last time: ').waitFor();
  const rows = await cells(card.locator('table'));
  return limited.flatMap((one, at) => {
    const series = progress.features.find(of => of.feature === one.name && (of.tool ?? null) === (one.tool ?? null) && of.space === one.space);
    const last = series?.points.find(point => point.session === before);
    const isPlain = one.value !== null && one.error && !one.is_lower_bound;
    return [
      ...(isPlain ? [[`outcome ${one.title}`, withoutUnit(rows[at][1]), text({ value: one.value, ...one.error })]] : []),
      [`outcome limit ${one.title}`, figuresIn(rows[at][2])[0], threeDigits(one.target.limit)],
      ...(last && last.value !== null && !last.is_lower_bound ? [[`last ${one.title}`, withoutUnit(rows[at][3]), text(last)]] : []),
    ];
  });
}

async function figuresOfSession() {
  const data = await getJson(`sessions/${session.id}`);
  await page.locator('.plots canvas').nth(3).waitFor();
  const places = await placesOf(data);
  const placesLoaded = () => page.waitForFunction(() => document.querySelector('.fourth .chooser [role=status]').textContent !== 'Loading …');
  await page.locator('.fourth .chooser [role=status]').waitFor({ state: 'attached' }); // It may be empty.
  await placesLoaded();
  const every = page.getByRole('button', { name: 'Compare every feature' });
  if (await every.count()) {
    await every.click();
    await every.waitFor({ state: 'detached' });
    await placesLoaded();
  }
  const [first, second] = data.compare_in?.space === 'image' ? ['image', '3d'] : ['3d', 'image'];
  const figures = [...(await outcomeFigures(data)), ...featureFigures(data, first, await featureCells(), places)];
  if (data.features.some(one => one.space === 'image')) {
    const press = space => page.getByRole('button', { name: { '3d': 'In space', image: 'In the image' }[space], exact: true }).click();
    await press(second);
    figures.push(...featureFigures(data, second, await featureCells(), places));
    await press(first);
  }
  const made = await facts(page.locator('.card', { has: page.getByRole('heading', { name: 'Made with' }) }).locator('dl'));
  const { video } = data;
  figures.push(['length', made.Length, clock(video.duration_s, 1)], ['file', made.File, bytes(video.bytes)],
    ['picture', figuresIn(made.Picture).join(), [video.width, video.height, video.frames].join()]);
  const seen = page.locator('.card', { has: page.getByRole('heading', { name: 'What was seen' }) });
  for (const tool of data.quality.tools) {
    const all = tool.observed + tool.predicted + tool.missing;
    const part = seen.locator('section', { has: page.getByRole('heading', { name: tool.tool, exact: true }) });
    figures.push([`${tool.tool} seen`, figuresIn(await part.locator('p.small').first().innerText()).join(' '),
      [tool.observed, tool.predicted, tool.missing].map(count => percent(count / all)).join(' ')]);
    const { 'Position error': error } = await facts(part.locator('dl'));
    if (error) figures.push([`${tool.tool} error`, figuresIn(error).join(' '), [threeDigits(tool.error_median_mm), '95', threeDigits(tool.error_p95_mm)].join(' ')]);
  }
  const frame = Number(/frame (\d+)/.exec(await page.locator('.transport .clock').innerText())[1]);
  const query = `from_frame=${frame}&to_frame=${frame + 1}&trimmed=false`;
  const path = await getJson(`sessions/${session.id}/trajectory?${query}`);
  for (const [at, name, x, y, z] of (await cells(page.locator('.readouts'))).map((row, at) => [at, ...row])) {
    const row = path.columns.tool.indexOf(at);
    const expected = row < 0 ? ['–', '–', '–'] : ['x_mm', 'y_mm', 'z_mm'].map(field => formatted(toDecimals(path.columns[field][row], 1)));
    figures.push([`${name} at frame ${frame}`, [x, y, z].join(), expected.join()]);
  }
  if (data.verdict?.level) {
    const said = await page.locator('.card', { has: page.getByRole('heading', { name: 'Skill', exact: true }) }).locator('p').first().innerText();
    figures.push(['probability', figuresIn(said)[0], wholePercent(data.verdict.probabilities[data.verdict.level])]);
  }
  return figures;
}

async function figuresOfSessions() {
  const shown = await page.locator('tbody tr').evaluateAll(rows =>
    rows.map(row => [row.querySelector('a').pathname.split('/').pop(), row.querySelector('td.number').textContent.trim()]));
  const data = new Map((await getJson('sessions?limit=50')).items.map(one => [one.id, one.video.duration_s]));
  assert.equal(shown.length, data.size);
  return shown.map(([id, length]) => [`length of ${id}`, length, data.get(id) === null ? '–' : clock(data.get(id), 0)]);
}

async function figuresOfToday() {
  const { queue } = await getJson('service');
  const [done, failed] = [await getAll('sessions?status=done'), await getAll('sessions?status=failed')];
  const recent = done.filter(one => Date.now() - Date.parse(one.created_at) < DAY_MS).length;
  await page.waitForFunction(() => !document.querySelector('.figures').textContent.includes('…'));
  const shown = await facts(page.locator('.figures'));
  const upTo50 = count => (count > 50 ? '50+' : String(count));
  return [['queued', shown['In the queue'], String(queue.queued)], ['running', shown['Being scored'], String(queue.running)],
    ['finished', shown['Scored in the last 24 h'], upTo50(recent)], ['failed', shown['Could not be scored'], upTo50(failed.length)]];
}

async function figuresOfTrainee() {
  const data = await getJson(`trainees/${session.trainee.id}/progress?${progress}`);
  const [series] = data.features;
  const points = series.points.filter(point => point.value !== null);
  const dots = await page.locator('svg.progress-plot a').evaluateAll(all => all.map(dot => dot.getAttribute('aria-label')));
  const said = await facts(page.locator('dl.facts'));
  const unit = series.unit === '1' ? '' : ` ${series.unit}`;
  const figures = points.map((point, at) =>
    [`session ${point.session}`, (dots[at] ?? '').includes(`, ${atLeast(point)}${threeDigits(point.value)}${unit}`) ? threeDigits(point.value) : dots[at], threeDigits(point.value)]);
  figures.push(['points', dots.length, points.length]);
  const { place, no_place: withheld, learning } = series;
  const of = place?.better_than ?? place?.percentile;
  const missingFigures = why => [...(why.missing ? [String(why.missing)] : []), ...figuresIn(why.detail)];
  figures.push(['place', figuresIn(said['Compared with others'].split('“')[0]).join(),
    (of ? [of.value, of.low, of.high].map(Math.round).concat(place.people) : withheld ? missingFigures(withheld) : []).join()]);
  if (learning.withheld) figures.push(['learning', figuresIn(said.Learning).join(), missingFigures(learning.withheld).join()]);
  if (learning.curve) figures.push(['plateau', figuresIn(said.Learning)[0], threeDigits(learning.curve.plateau.value)]);
  const { rule, charts } = data;
  if (rule) {
    const { then_more: more, at_most: most } = rule;
    const required = [rule.in_a_row, ...(more ? [more] : []), ...(most ? [most] : [])];
    const sofar = rule.state === 'met' ? [rule.met_at] : rule.state === 'out_of_reach' ? []
      : [rule.have_in_a_row, rule.in_a_row, ...(rule.then_more ? [rule.have_more, rule.then_more] : []), ...(rule.unknown ? [rule.unknown] : [])];
    figures.push(['rule', figuresIn(said['Pass rule']).join(), [...required, ...sofar].join()]);
  }
  if (charts) {
    const rates = figuresIn(said.Proficiency).slice(-3).join();
    figures.push(['rates', rates, [charts.design.declare_within, percent(charts.declared_wrongly), percent(charts.declared_rightly)].join()]);
    const scores = await page.locator('svg.monitor circle title').allTextContents();
    const path = charts.path.filter(Boolean);
    figures.push(['chart', scores.map(text => figuresIn(text).join(': ')).sort().join(), path.map(one => `${one.session}: ${threeDigits(one.score)}`).sort().join()]);
  }
  return figures;
}

async function figuresOfGroups() {
  const [groups, cohorts] = [await getAll('groups'), await getAll('cohorts')];
  const [first, second] = [page.locator('table').first(), page.locator('table').nth(1)];
  const counts = table => cells(table).then(rows => new Map(rows.map(row => [row[0], row])));
  const [shown, compared] = [await counts(first), await counts(second)];
  return [...groups.map(one => [one.name, shown.get(one.name)?.[1], String(one.trainees.length)]),
    ...cohorts.map(one => [one.name, compared.get(`${one.name}${one.code}`)?.[2], String(one.people)])];
}

async function figuresOfGroup() {
  const data = await getJson(`groups/${session.group}/progress?task=${session.task.id}`);
  const rows = await cells(page.locator('.group-table'));
  const rowOf = name => rows.find(([first]) => first.startsWith(name)); // Below the name is what a narrow page shows there.
  return data.rows.flatMap(row => {
    const name = data.trainees.find(one => one.id === row.trainee).name;
    const newest = row.points.at(-1);
    const value = !newest ? '–' : newest.low === null ? `${atLeast(newest)}${threeDigits(newest.value)}` : withError(newest.value, newest).join(' ± ');
    return [[`${name}, value`, rowOf(name)?.[2], value], [`${name}, sessions`, rowOf(name)?.[5], String(row.sessions)]];
  });
}

async function figuresOfTask() {
  const at = `tasks/${session.task.id}`;
  const [standard] = (await getJson(`${at}/standards`)).items;
  const figures = [];
  if (standard) {
    const card = page.locator('.card', { has: page.locator('#standard-in-use') });
    figures.push(['version', figuresIn(await card.locator('p').first().innerText())[0], String(standard.version)]);
    (await cells(card.locator('table'))).forEach((row, i) => {
      const { limit, low, high } = standard.targets[i];
      const expected = [limit, ...(low === null ? [] : [low, high])];
      figures.push([row[0], figuresIn(row[1]).join(), expected.map(threeDigits).join()]);
    });
    const { rule, charts } = standard;
    const said = await facts(card.locator('dl.facts'));
    figures.push(['design', figuresIn(said.Chart).join(),
      [percent(charts.inadequate), percent(charts.adequate), charts.declare_within, percent(charts.false_declaration)].join()]);
    if (rule) figures.push(['rule', figuresIn(said['Pass rule']).join(), [rule.in_a_row, rule.then_more, rule.at_most].filter(Boolean).join()]);
  }
  const target = standard?.targets[0];
  const query = new URLSearchParams({ feature: target?.feature ?? 'duration', ...(target?.tool && { tool: target.tool, hand: target.made_from?.handedness ?? 'right' }) });
  if (target) query.set('limit', target.limit);
  const spread = await getJson(`${at}/distribution?${query}`);
  const plot = page.locator('svg.spread');
  const [{ values, keeping, withheld }] = spread.groups;
  if (values.length) {
    await plot.waitFor();
    const dots = await plot.locator('circle title').allTextContents();
    figures.push(['dots', dots.map(text => figuresIn(text)[0]).join(), values.map(threeDigits).join()]);
    const said = await page.locator('.slide + ul').innerText();
    const expected = keeping ? [keeping.seen, keeping.low, keeping.high, keeping.expected].map(percent) : withheld ? figuresIn(withheld.detail) : [];
    figures.push(['share', figuresIn(said).join(), expected.join()]);
  }
  const [model] = (await getJson(`${at}/models`)).items;
  if (model && !model.withdrawn_at && model.report.knows) {
    const { value, low, high, people } = model.report.accuracy;
    const said = await page.locator('.card', { has: page.getByRole('heading', { name: 'Model of skill' }) }).locator('.body').innerText();
    figures.push(['model', figuresIn(said).join(), [model.version, ...[value, low, high].map(wholePercent), people].join()]);
  }
  return figures;
}

async function figuresOfBoxes() {
  const rows = new Map((await cells(page.locator('table'))).map(row => [row[0], row[2]]));
  const boxes = (await getAll('boxes')).filter(box => box.calibration);
  return boxes.map(box => [box.name, rows.get(box.name), Number.isFinite(box.calibration.rms_px) ? `RMS ${threeDigits(box.calibration.rms_px)} px` : 'Given as a file']);
}

async function figuresOfBox() {
  const at = `boxes/${session.box.id}`;
  const [camera, palettes, tests] = [await getJson(`${at}/camera`), await getAll(`${at}/palettes`), await getAll(`${at}/self-tests`)];
  const card = name => page.locator('section.card', { has: page.getByRole('heading', { level: 2, name, exact: true }) });
  const said = await facts(card('Camera').locator('dl.facts').first());
  const figures = [
    ['residual', said['Residual (RMS)'], Number.isFinite(camera.rms_px) ? `${threeDigits(camera.rms_px)} px` : '–'],
    ['picture', said.Picture, `${camera.width} × ${camera.height}`],
    ['focal length', said['Focal length'], `${threeDigits(camera.fx)} × ${threeDigits(camera.fy)} px`],
    ['principal point', said['Principal point'], `${threeDigits(camera.cx)}, ${threeDigits(camera.cy)} px`],
  ];
  const [tapes, counts] = [await cells(card('Tool colours').locator('table').first()), await cells(card('Tool colours').locator('table').nth(1))];
  palettes[0].tools.forEach((tool, i) => figures.push([tool.name, tapes[i].slice(-2).join(),
    [tool.diameter_mm, tool.band_length_mm].map(size => (size ? `${threeDigits(size)} mm` : '–')).join()]));
  palettes[0].counts.forEach((one, i) => figures.push([`samples of ${one.label}`, counts[i][1], String(one.samples)]));
  if (tests[0]?.holds.length) {
    const mm = value => (value === null ? '–' : formatted(toDecimals(value, 2)));
    (await cells(card('Self-test').locator('table'))).forEach((row, i) => {
      const { from_s, error_mm, along_mm, across_mm } = tests[0].holds[i];
      figures.push([`rest ${i}`, [row[1], ...row.slice(3, 6)].join(), [toDecimals(from_s, 1), ...[error_mm, along_mm, across_mm].map(mm)].join()]);
    });
  }
  return figures;
}

async function figuresOfService() {
  const data = await getJson('service');
  const { version, pipeline, storage, queue, settings } = data;
  const said = Object.assign({}, ...(await Promise.all((await page.locator('dl.facts').all()).map(facts))));
  const all = await Promise.all((await page.locator('dl.facts').all()).map(facts));
  const [kept] = all.filter(one => 'Database' in one);
  const figures = [
    ['version', said.Program, version], ['pipeline', said['Measurement version'], pipeline],
    ['files', figuresIn(kept['Recordings and results']).join(), [bytes(storage.files_bytes).split(' ')[0], storage.files].join()],
    ['waiting', said.Waiting, String(queue.queued)], ['quarantined', said['On hold after crashes'], String(queue.quarantined)],
    ['largest', said['Largest recording'], bytes(settings.max_upload_bytes)], ['workers', said['Recordings tracked at once'], String(settings.workers)],
    ['erased', figuresIn(said['Deleted data is gone from the disk'])[0], String(settings.erased_within_s)],
    ['unfinished', figuresIn(said['Unfinished uploads are discarded'])[0], String(settings.unfinished_upload_h)],
    ['sign-in', figuresIn(said['A sign-in ends']).join(), [settings.idle_min, settings.sign_in_h].join()],
    ['attempts', figuresIn(said['Sign-in attempts'])[0], String(settings.attempts_per_min)],
  ];
  const changes = (await getJson('audit?limit=25')).items;
  (await cells(page.locator('table'))).forEach((row, i) =>
    figures.push([`change ${i}`, row.slice(2).join(), [changes[i].address ?? '–', `${changes[i].action} ${changes[i].noun}`, changes[i].called ?? changes[i].subject].join()]));
  return figures;
}

async function figuresOfSessionReport() {
  const data = await getJson(`sessions/${session.id}`);
  const { features } = data;
  const listed = featuresIn(data, data.compare_in?.space ?? '3d');
  const measured = one => `${one.error ? withError(one.value, one.error).join(' ± ') : withoutBar(one)}${['', '1'].includes(one.unit) ? '' : ` ${one.unit}`}`;
  const judged = await cells(page.locator('table.targets'));
  const figures = features.filter(one => one.target && one.value !== null).slice(0, judged.length)
    .map((one, i) => [one.title, judged[i].slice(1, 3).map(text => figuresIn(text).join()).join(), [threeDigits(one.target.limit), figuresIn(measured(one)).join()].join()]);
  const head = await page.locator('table.values thead th').allInnerTexts();
  for (const row of await cells(page.locator('table.values')))
    row.slice(1).forEach((shown, i) => {
      const one = listed.find(of => of.title === row[0] && (of.tool ?? 'Session') === head[i + 1]);
      if (one?.value !== null && one) figures.push([`${row[0]}, ${head[i + 1]}`, shown, measured(one)]);
    });
  return figures;
}

/** As on the pages: no line breaks within a date. */
const day = iso => new Intl.DateTimeFormat('en-US', { dateStyle: 'medium' }).format(new Date(iso)).replaceAll(' ', '\u00a0');

async function figuresOfCertificate() {
  const { standard, passed, rule, sessions, trainee, task, pipeline } = await getJson(`trainees/${pass.trainee}/progress?task=${pass.task}`);
  const paper = page.locator('.certificate');
  const [, , said, set] = await paper.locator(':scope > p').allInnerTexts();
  const made = await facts(paper.locator('.provenance dl'));
  const rows = await cells(paper.locator('table'));
  const targets = await paper.locator('li').allInnerTexts();
  const required = [rule?.in_a_row, rule?.then_more || null, rule?.at_most].filter(value => value !== null && value !== undefined);
  return [
    ['rule', figuresIn(said.replace(task.name, '')).join(), passed.by === 'rule' ? required.join() : ''],
    ['passed at', set.includes(day(passed.at)), true],
    ['version', figuresIn(set.replace(day(passed.at), ''))[0], String(standard.version)],
    ...standard.targets.map(({ limit }, i) => [`target ${i}`, figuresIn(targets[i].split(':').at(-1))[0], threeDigits(limit)]),
    ['sessions', rows.map(row => row.slice(0, 2).join(' ')).join('; '),
      sessions.filter(one => passed.sessions.includes(one.number)).map(one => `${one.number} ${day(one.recorded_at)}`).join('; ')],
    ['pipeline', made.Program, pipeline], ['trainee', made.Trainee, trainee.code], ['task', made.Task, task.code],
  ];
}

async function figuresOfTraineeReport() {
  const data = await getJson(`trainees/${session.trainee.id}/progress?${progress}`);
  const series = data.features.slice(0, 3);
  const about = await facts(page.locator('.report dl.about'));
  const counted = data.sessions.filter(one => !one.set_aside).length;
  const figures = [['sessions', figuresIn(about.Sessions).join(), [data.earlier + data.sessions.length, counted].join()],
    ['period', about.Period, [...new Set([data.sessions[0], data.sessions.at(-1)].map(one => day(one.recorded_at)))].join(' – ')]];
  const last = data.sessions.slice(-14);
  const rows = await cells(page.locator('.report table'));
  figures.push(['rows', rows.length, last.length]);
  last.forEach((one, i) => {
    const measured = series.map(({ points, unit }) => {
      const point = points.find(({ session: number }) => number === one.number);
      if (!point || point.value === null) return '–';
      const value = point.low === null ? withoutBar(point) : withError(point.value, point).join(' ± ');
      return `${value}${['', '1'].includes(unit) ? '' : ` ${unit}`}`;
    });
    figures.push([`session ${one.number}`, rows[i].slice(0, 2 + series.length).join('; '), [one.number, day(one.recorded_at), ...measured].join('; ')]);
  });
  const dots = await page.locator('.report svg.progress-plot circle.dot').count();
  figures.push(['dots', dots, series.flatMap(one => one.points).filter(point => point.value !== null).length]);
  return figures;
}

/** The figures on a trainee's own page: the last result with its limits, and the passes in a row; no counts of the queue. */
async function figuresOfOwnToday() {
  const [last] = (await getJson('sessions?status=done&limit=1')).items;
  const data = await getJson(`sessions/${last.id}`);
  const { rule } = await getJson(`trainees/${last.trainee.id}/progress?task=${last.task.id}`);
  const home = page.locator('.home');
  await home.getByText(last.task.name).first().waitFor();
  const passes = rule?.state === 'open' ? [rule.have_in_a_row, rule.in_a_row].join() : '';
  if (passes) await home.locator('.way').waitFor();
  const time = data.features.find(one => one.name === 'duration' && !one.tool);
  const said = (await home.innerText()).match(/Time (\S+( ± \S+)?) s/)?.[1];
  return [
    ...(time?.value && time.error && data.quality.verdict !== 'refused' ? [['time', said, withError(time.value, time.error).join(' ± ')]] : []),
    ['in a row', passes && figuresIn(await home.locator('.way p').innerText()).join(), passes],
    ['figures of the queue', await page.locator('.figures').count(), 0], ...(await outcomeFigures(data)),
  ];
}

/** Alters the values and the limits that the card of a session shows; one of them may be missing. */
const alterOutcome = ({ features }) => features.forEach(one => {
  if (one.value) one.value *= 1.1;
  if (one.target) one.target.limit *= 1.1;
});

/**
 * For each page: its address, the function that reads its figures, and an alteration of a REST answer that it must
 * show.
 */
const pages = () => ({
  today: ['/', figuresOfToday, '**/api/v1/sessions?status=failed*', data => data.items.push(...[0, 1].map(n => ({ id: `none-${n}`, status: 'failed' })))],
  sessions: ['/sessions', figuresOfSessions, '**/api/v1/sessions?*order=recorded*', data => (data.items.find(one => one.video.duration_s).video.duration_s += 1)],
  session: [`/sessions/${session.id}`, figuresOfSession, `**/api/v1/sessions/${session.id}`, data => (featuresIn(data, data.compare_in?.space ?? '3d').find(one => one.value).value *= 1.01)],
  'session’s report': [`/sessions/${session.id}/report`, figuresOfSessionReport, `**/api/v1/sessions/${session.id}`,
    data => data.features.filter(one => one.value).forEach(one => (one.value *= 1.01))],
  trainee: [`/trainees/${session.trainee.id}?${progress}`, figuresOfTrainee, '**/progress?*', data => (data.features[0].points.find(one => one.value !== null).value *= 1.01)],
  'trainee’s report': [`/trainees/${session.trainee.id}/report?${progress}`, figuresOfTraineeReport, '**/progress?*',
    data => (data.features[0].points.find(one => one.value !== null).value *= 1.01)],
  certificate: pass && [`/trainees/${pass.trainee}/certificate?task=${pass.task}`, figuresOfCertificate, '**/progress?*', data => (data.standard.targets[0].limit += 1)],
  'own today': ['/', figuresOfOwnToday, '**/api/v1/sessions?status=done*', data => alterOutcome(data.items[0])],
  groups: ['/groups', figuresOfGroups, '**/api/v1/cohorts?*', data => (data.items[0].people += 1)],
  group: [`/groups/${session.group}?task=${session.task.id}`, figuresOfGroup, '**/progress?*', data => (data.rows.find(one => one.points.length).points.at(-1).value *= 1.01)],
  task: [`/tasks/${session.task.id}`, figuresOfTask, '**/distribution?*', data => (data.groups[0].values[0] *= 1.01)],
  boxes: ['/boxes', figuresOfBoxes, '**/api/v1/boxes?*', data => data.items.forEach(one => one.calibration && (one.calibration.rms_px = 0.987))],
  box: [`/boxes/${session.box.id}`, figuresOfBox, '**/camera', data => (data.fx += 10)],
  service: ['/service', figuresOfService, '**/api/v1/service', data => (data.settings.attempts_per_min += 1)],
});

before(async () => {
  browser = await launch();
  const user = await person(browser);
  ({ page, create, open } = user);
  await page.goto(`${url}/sessions`);
  await user.signIn();
  await user.heading('Sessions').waitFor();
  cookie = await cookieOf(page);
  await untilQueueIsEmpty();
  const isWanted = one => one.source.kind === 'recording' && !one.set_aside && (!process.env.TROCAR_TASK || one.task.name === process.env.TROCAR_TASK);
  // Lower bounds have a text of their own, which these comparisons do not read: a session without them comes first.
  const hasLowerBound = one => one.features.some(of => of.is_lower_bound);
  const wanted = (await getAll('sessions?status=done')).filter(isWanted);
  session = wanted.find(one => !hasLowerBound(one)) ?? wanted[0];
  assert.ok(session, 'a scored recording');
  if (!(await getAll('cohorts')).length) await create('cohorts', { name: 'Everybody' });
  session.group = (await getAll('groups')).find(one => one.trainees.includes(session.trainee.id))?.id ?? (await groupWith(session.trainee));
  const [cohort] = await getAll('cohorts');
  progress = new URLSearchParams({ task: session.task.id, cohort: cohort.code }).toString();
  pass = await findPass();
});

after(() => browser?.close());

/** Waits until the queue is empty: a figure that changes between the page and REST proves nothing. */
async function untilQueueIsEmpty() {
  const isEmpty = ({ queue }) => queue.queued + queue.running === 0;
  for (let waited = 0; !isEmpty(await getJson('service')); waited++) {
    assert.ok(waited < 240, 'the queue is not empty after two minutes');
    await new Promise(resolve => setTimeout(resolve, 500));
  }
}

const cookieOf = async of => (await of.context().cookies()).map(({ name, value }) => `${name}=${value}`).join('; ');

/** A trainee and a task that this trainee has passed; null if there is none. */
async function findPass() {
  const done = await getAll('sessions?status=done');
  const pairs = new Map(done.map(({ trainee, task }) => [`${trainee.id} ${task.id}`, { trainee: trainee.id, task: task.id }]));
  for (const pair of pairs.values()) if ((await getJson(`trainees/${pair.trainee}/progress?task=${pair.task}`)).passed) return pair;
  return null;
}

async function groupWith(trainee) {
  const { id } = await create('groups', { name: `With ${trainee.name}` });
  const headers = { cookie, 'content-type': 'application/json', origin: url };
  const body = JSON.stringify({ instructors: [], trainees: [trainee.id] });
  const answer = await fetch(`${url}/api/v1/groups/${id}/members`, { method: 'PUT', headers, body });
  assert.ok(answer.ok, await answer.text());
  return id;
}

/** Rows of tables are read with plain spaces, and dates hold no-break spaces. */
const withPlainSpaces = value => (typeof value === 'string' ? value.replaceAll('\u00a0', ' ') : value);

const differing = figures => figures.filter(([, shown, expected]) => withPlainSpaces(shown) !== withPlainSpaces(expected))
  .map(([what, shown, expected]) => `${what}: the page shows ${shown}, REST has ${expected}`);

/** Compares the figures of a page with REST, then opens the page with an altered answer and expects a difference. */
async function compare(t, name) {
  if (!pages()[name]) return t.skip('no trainee has passed in this centre');
  const [path, figuresOf, altered, change] = pages()[name];
  await open(path);
  const figures = await figuresOf();
  assert.ok(figures.length > 0, 'nothing to compare');
  assert.deepEqual(differing(figures), []);
  console.log(`${name}: ${figures.length} figures compared`);
  await page.route(altered, async route => {
    const answer = await route.fetch();
    const data = await answer.json();
    change(data);
    await route.fulfill({ response: answer, json: data });
  });
  await open(path);
  const noticed = differing(await figuresOf());
  await page.unroute(altered);
  assert.notEqual(noticed.length, 0, 'the comparison missed the altered answer');
}

const PAGES = ['today', 'sessions', 'session', 'session’s report', 'trainee', 'trainee’s report', 'certificate', 'groups', 'group', 'task', 'boxes',
  'box', 'service'];
for (const name of PAGES)
  test(`${name}: the page shows the figures of REST, and the comparison detects an altered answer`, t => compare(t, name));

test('a trainee’s own pages show the figures of REST, and the comparison detects an altered answer', async t => {
  const account = { login: `figures-${Date.now()}`, name: session.trainee.name, role: 'trainee', password: 'a password of a trainee', trainee: session.trainee.id };
  await create('people', account);
  const [ours, own] = [{ page, open, cookie }, await person(browser)];
  try {
    ({ page, open } = own);
    await page.goto(url);
    await own.signIn(account.password, account.login);
    await own.heading('Today').waitFor();
    cookie = await cookieOf(page);
    for (const name of ['own today', 'sessions', 'session', 'session’s report', 'trainee', 'trainee’s report']) await compare(t, name);
  } finally {
    await page.context().close();
    ({ page, open, cookie } = ours);
  }
});

test('below a value the page shows its place in the cohort, with the interval', async () => {
  const place = { percentile: { value: 37.4, low: 12.2, high: 66.7 }, better_than: { value: 62.6, low: 33.3, high: 87.8 }, people: 14, error_known: true };
  const altered = '**/progress?*cohort=*';
  await page.route(altered, async route => {
    const answer = await route.fetch();
    const data = await answer.json();
    data.sessions = data.sessions.filter(one => one.id === session.id);
    place.session = data.sessions[0].number;
    for (const one of data.features) Object.assign(one, { place: one.better === 'neither' ? { ...place, better_than: null } : place, no_place: null });
    await route.fulfill({ response: answer, json: data });
  });
  await open(`/sessions/${session.id}`);
  const better = page.locator('.fourth td .place', { hasText: 'better than 63 % (33 – 88 %)' });
  await better.first().waitFor();
  assert.match(await better.first().getAttribute('title'), /^Better than 63 % \(33 – 88 %\) of 14 people of “/);
  await page.getByLabel('Compared with').selectOption({ label: 'no comparison' });
  await better.first().waitFor({ state: 'detached' });
  await page.unroute(altered);
});

// Live figures. REST has no answer with these figures: the page must show those of the last message on its own socket.

/**
 * Intercepts the live sockets of a page, and returns the last messages of each by session. `change` alters every
 * message on its way. A feed that is held passes one more frame, which begins a new second, and after it only pictures.
 * So the numbers no longer change, and the page's clock confirms that they belong to this last frame.
 */
async function interceptLiveSockets(of, change = () => {}) {
  const feeds = new Map();
  await of.routeWebSocket(/\/sessions\/[^/]+\/live/, socket => {
    const feed = { features: [], frame: null, isHeld: false, isStopped: false };
    feeds.set(new URL(socket.url()).pathname.split('/').at(-2), feed);
    const service = socket.connectToServer();
    service.onMessage(data => {
      if (typeof data !== 'string') return socket.send(data);
      if (feed.isStopped) return;
      const message = JSON.parse(data);
      const isFrame = message.type === 'frame';
      const beginsSecond = () => secondsOf(message) > secondsOf(feed.frame) && Date.now() > feed.at + WRITE_INTERVAL_MS;
      if (feed.isHeld && !(isFrame && hasAllTips(message) && beginsSecond())) return;
      feed.isStopped = feed.isHeld;
      if (isFrame) [feed.frame, feed.at] = [message, Date.now()];
      if (message.type === 'features') feed.features = message.features;
      const altered = structuredClone(message);
      change(altered);
      socket.send(JSON.stringify(altered));
    });
  });
  return feeds;
}

/** The page writes the numbers at most once in this time, and skips those that arrive sooner. */
const WRITE_INTERVAL_MS = 250;
const hasAllTips = frame => frame.tools.every(tool => tool.tip_mm);
const secondsOf = frame => Math.round(frame.time_s);

/**
 * Waits until a session's feed has sent features, holds it, waits until the page shows its last frame, and returns it.
 */
async function holdFeed(feeds, id, shown) {
  const hasPath = ({ name, value }) => name === 'path_length' && value !== null;
  const hasFeatures = feed => feed?.frame && feed.features.some(hasPath);
  await waitUntil(() => hasFeatures(feeds.get(id)), 'features so far');
  const feed = feeds.get(id);
  feed.isHeld = true;
  await waitUntil(() => feed.isStopped, 'one more frame with every tool');
  await shown.filter({ hasText: clock(feed.frame.time_s, 0) }).waitFor();
  await pause(WRITE_INTERVAL_MS); // The page writes the clock at once, the other numbers at the end of the interval.
  return feed;
}

async function figuresOfLive(of, { frame, features }) {
  const figures = [];
  for (const [at, tool] of (await of.locator('.live-tool').all()).entries()) {
    const { tip_mm: tip, sigma_mm: [across, along], speed_mm_s: speed } = frame.tools[at];
    const expected = [...tip.map((value, axis) => `${formatted(toDecimals(value, 1))} ± ${formatted(toDecimals(axis < 2 ? across : along, 1))} mm`), `${formatted(toDecimals(speed, 0))} mm/s`];
    const shown = await tool.locator('.position tr').evaluateAll(rows => rows.map(row => [...row.cells].slice(1).map(cell => cell.textContent).filter(Boolean).join(' ')));
    expected.forEach((text, row) => figures.push([`tool ${at}, row ${row}`, shown[row], text]));
  }
  if (frame.distance_mm) {
    const [distance, sigma] = frame.distance_mm;
    figures.push(['distance', (await of.locator('.distance dd').innerText()).replace(/\s+/g, ' '), `${toDecimals(distance, 1)} ± ${toDecimals(sigma, 1)} mm`]);
  }
  const table = of.locator('.live-features');
  const tools = (await table.locator('thead th').allInnerTexts()).slice(1, -1);
  for (const [title, ...values] of await cells(table))
    tools.forEach((tool, at) => {
      const one = features.find(other => other.title === title && other.tool === tool);
      const expected = one.value === null ? 'too little seen yet' : threeDigits(one.value);
      figures.push([`${title}, ${tool}`, values[at], expected]);
    });
  return figures;
}

async function figuresOfWall(of, { features }) {
  const tile = of.locator('.tile', { hasText: session.box.name });
  const rows = await tile.locator('li').evaluateAll(all => all.map(row => [row.querySelector('.tool').textContent, row.querySelector('.path').textContent]));
  return rows.map(([tool, shown]) => {
    const path = features.find(one => one.name === 'path_length' && one.tool === tool);
    return [`path of ${tool}`, figuresIn(shown).join(), path?.value === null ? '' : threeDigits(path.value)];
  });
}

test('live pages show the figures of the last socket message; the comparison detects an altered message', async t => {
  // A live.mp4 can hold the JPEG frames of a feed, and Chromium cannot play those.
  const isPlayable = one => one.source.kind === 'recording' && one.task.id === session.task.id && one.filename !== 'live.mp4';
  const sent = (await getAll('sessions?status=done')).find(isPlayable);
  if (!sent) return t.skip('no recording in this centre that a browser can play');
  const sender = await page.context().newPage();
  await sender.goto(url);
  const { trainee, task, box } = await getJson(`sessions/${sent.id}`);
  const arriving = await beginFeed(sender, { recording: sent.id, box: box.code, trainee: trainee.code, task: task.code });
  const moved = ({ type, tools }) => type === 'frame' && tools.forEach(tool => tool.tip_mm && (tool.tip_mm[0] += 1));
  const farther = ({ type, features }) => type === 'features' && features.forEach(one => one.value && (one.value *= 1.01));
  try {
    for (const [name, path, figuresOf, changes] of [['live page', `/sessions/${arriving}`, figuresOfLive, [moved, farther]], ['wall', '/live', figuresOfWall, [farther]]])
      for (const change of [undefined, ...changes]) {
        const watcher = await page.context().newPage();
        const feeds = await interceptLiveSockets(watcher, change);
        await watcher.goto(url + path);
        const clockOf = name === 'wall' ? watcher.locator('.tile', { hasText: box.name }).locator('.elapsed') : watcher.locator('.elapsed');
        const figures = await figuresOf(watcher, await holdFeed(feeds, arriving, clockOf));
        assert.ok(figures.length > 0, 'nothing to compare');
        if (change) assert.notEqual(differing(figures).length, 0, `${name}: the comparison missed the altered message`);
        else assert.deepEqual(differing(figures), []);
        if (!change) console.log(`${name}: ${figures.length} figures compared`);
        await watcher.close();
      }
  } finally {
    await endFeed(sender);
    await sender.close();
  }
});
