// Translates the service's English texts into the page's language, by the code that accompanies each text. A text
// without a code, or without a translation of its code, stays English; `lang` then marks a problem's detail or a
// self-test's part.
import { serviceLang, t } from './texts.js';

const { said: translations } = t;
/** For objects with a `title`: the kind of object and the key that holds its code. */
const TITLE_KEYS = [['features', 'feature'], ['features', 'name'], ['forms', 'form'], ['exercises', 'task']];
const PROBLEM = '/problems/';

/** Translates a response of the service in place, at any depth. Arrays of numbers are skipped. */
export function translateAnswer(answer) {
  if (serviceLang && answer && typeof answer === 'object') walk(answer);
  return answer;
}

function walk(value) {
  if (!Array.isArray(value)) translateObject(value);
  const inside = Array.isArray(value) ? value : Object.values(value);
  if (Array.isArray(value) && typeof value[0] !== 'object') return;
  for (const object of inside) if (object && typeof object === 'object') walk(object);
}

function translateObject(object) {
  if ('title' in object) object.title = titleOf(object) ?? object.title;
  if ('detail' in object && 'title' in object) translateProblem(object);
  else if ('detail' in object && 'reason' in object) object.detail = translations.withheld[object.reason] ?? object.detail;
  if ('anchors' in object) translateRatingItem(object);
  if ('finding' in object && 'name' in object) translateConcern(object);
  if (Array.isArray(object.parts)) object.parts.forEach(part => translateSelfTestPart(part, object));
}

const titleOf = object => TITLE_KEYS.map(([kind, key]) => translations[kind][object[key]]).find(words => typeof words === 'string');

/** The code is in `type` for a response and in `slug` for a job's problem. The detail may depend on other members. */
function translateProblem(problem) {
  const code = problem.slug ?? problem.type?.replace(PROBLEM, '');
  const [title, translated] = translations.problems[code] ?? [];
  const detail = typeof translated === 'function' ? translated(problem) : translated;
  Object.assign(problem, { title: title ?? problem.title, detail: detail ?? problem.detail, lang: detail ? undefined : serviceLang });
}

function translateRatingItem(item) {
  const [title, meanings] = translations.items[item.name] ?? [];
  if (!meanings) return;
  item.title = title;
  item.anchors.forEach((anchor, index) => (anchor.words = meanings[index] ?? anchor.words));
}

function translateConcern(concern) {
  const [finding, advice] = translations.findings[concern.name] ?? [];
  if (!finding) return;
  const toolPrefix = concern.tool ? `${concern.tool}: ` : '';
  const nearest = concern.label ? translations.nearest(concern.label) : '';
  concern.finding = `${toolPrefix}${finding(concern.figure, concern.limit)}${nearest}`;
  concern.advice = advice;
}

/** Translates a part of a self-test; a part without advice gets none. */
function translateSelfTestPart(part, test) {
  const [finding, advice] = translations.selfTest[`${part.part} ${part.unit}`]?.(part, test) || [];
  Object.assign(part, finding ? { finding, advice: part.advice && advice } : { lang: serviceLang });
}
