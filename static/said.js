// What the service says in English, in the page's language: by the code that stands beside it. What has no code, or no words
// for its code, stays as it is; `lang` says so of a problem's detail and of a self-test's part.
import { t, theirs } from './texts.js';

const { said } = t;
/** What a thing with a `title` is, and the key that holds its code. */
const TITLED = [['features', 'feature'], ['features', 'name'], ['forms', 'form'], ['exercises', 'task']];
const PROBLEM = '/problems/';

/** Changes an answer of the service, as deep as it goes. Rows of numbers are passed by. */
export function inOurWords(answer) {
  if (theirs && answer && typeof answer === 'object') walk(answer);
  return answer;
}

function walk(value) {
  if (!Array.isArray(value)) reword(value);
  const inside = Array.isArray(value) ? value : Object.values(value);
  if (Array.isArray(value) && typeof value[0] !== 'object') return;
  for (const one of inside) if (one && typeof one === 'object') walk(one);
}

function reword(one) {
  if ('title' in one) one.title = titleOf(one) ?? one.title;
  if ('detail' in one && 'title' in one) rewordProblem(one);
  else if ('detail' in one && 'reason' in one) one.detail = said.withheld[one.reason] ?? one.detail;
  if ('anchors' in one) rewordItem(one);
  if ('finding' in one && 'name' in one) rewordFinding(one);
  if (Array.isArray(one.parts)) one.parts.forEach(part => rewordPart(part, one));
}

const titleOf = one => TITLED.map(([kind, key]) => said[kind][one[key]]).find(words => typeof words === 'string');

/** Of an answer `type` is the code, of a job's problem `slug`. What to do may depend on what else the problem tells. */
function rewordProblem(problem) {
  const code = problem.slug ?? problem.type?.replace(PROBLEM, '');
  const [title, say] = said.problems[code] ?? [];
  const detail = typeof say === 'function' ? say(problem) : say;
  Object.assign(problem, { title: title ?? problem.title, detail: detail ?? problem.detail, lang: detail ? undefined : theirs });
}

function rewordItem(item) {
  const [title, means] = said.items[item.name] ?? [];
  if (!means) return;
  item.title = title;
  item.anchors.forEach((anchor, at) => (anchor.words = means[at] ?? anchor.words));
}

function rewordFinding(concern) {
  const [finding, advice] = said.findings[concern.name] ?? [];
  if (!finding) return;
  const whose = concern.tool ? `${concern.tool}: ` : '';
  const nearest = concern.label ? said.nearest(concern.label) : '';
  concern.finding = `${whose}${finding(concern.figure, concern.limit)}${nearest}`;
  concern.advice = advice;
}

/** Of a self-test: nothing to do is no advice. */
function rewordPart(part, test) {
  const [finding, advice] = said.selfTest[`${part.part} ${part.unit}`]?.(part, test) || [];
  Object.assign(part, finding ? { finding, advice: part.advice && advice } : { lang: theirs });
}
