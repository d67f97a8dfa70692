// The service answers in English and gives each text a code. These functions return a text in the page's language, by
// its code. A text without a code, or without a translation of its code, stays English; `lang` then marks a problem's
// detail and a self-test's part. The reasons for a missing position are in `session.reasons` of both languages.
import { BOX_REFUSALS, CONFLICTS, findSentence } from './conflicts.js';
import { INVALID_VALUES } from './invalid_values.js';
import { serviceLang, t } from './texts.js';

const PROBLEM = '/problems/';
/** The problems with the sentences of `CONFLICTS`. */
const CONFLICT_CODES = ['conflict', 'gone', 'in-use', 'too-many'];
const REFUSED_BY_BOX = 'refused_by_box';

/** English has few translations, because the service speaks it. @type {Record<string, any>} */
const translations = t.said;

const translationOf = (kind, code) => translations[kind]?.[code];

/**
 * `feature` holds the code in an object about a feature, and `name` in the feature itself.
 *
 * @param {{ feature?: string, name?: string, title: string }} one
 */
export const featureTitle = ({ feature, name, title }) => translationOf('features', feature ?? name) ?? title;

/** The hand and the tool in it: `left hand (red)`. The hand that a standard names comes first: `dominant hand (red)`. */
export function handText({ tool, in_hand: hand, target }) {
  const named = target?.in_hand ?? hand;
  if (!named) return tool ?? '';
  return tool ? `${t.hands[named]} (${tool})` : t.hands[named];
}

/** A tool with the hand that it was in during this session, if that is known. */
export const toolWithHand = (features, tool) => handText({ tool, in_hand: features.find(one => one.tool === tool)?.in_hand, target: null });

/** The feature, its hand or tool, and whether it is measured in the image: `Path length, left hand, in the image`. */
export const featureWithTool = one =>
  [featureTitle(one), handText(one), one.space === 'image' && t.session.inImage].filter(Boolean).join(', ');

/** The title of a rating form. */
export const formTitle = ({ form, title }) => translationOf('forms', form) ?? title;

/** The title of the exercise that a published limit belongs to. */
export const exerciseTitle = ({ preset, title }) => translationOf('exercises', preset) ?? title;

/** Why there is no number. */
export const reasonText = ({ reason, detail }) => translationOf('withheld', reason) ?? detail;

/** Why a session has no error score. @param {{ reason: string, detail: string }} none */
export const noErrorScoreText = ({ reason, detail }) => translationOf('noErrorScores', reason) ?? detail;

/** Name and hint of an item of an example, in the page's language. @param {Schemas['ErrorItem']} item */
export const exampleItemText = ({ item, name, hint }) => translationOf('errorItems', item) ?? [name, hint];

/** The note of an example's formula. @param {string | null | undefined} note */
export const exampleNote = note => translations?.errorNote ?? note;

export const ratingItemTitle = ({ name, title }) => translationOf('items', name)?.[0] ?? title;

/** In the service's own form: which published item it is taken from; null otherwise. @param {Schemas['ItemInfo']} item */
export const ratingItemSource = ({ name, source }) => translationOf('items', name)?.[2] ?? source;

/** What the mark of an item's anchor means. */
export const anchorText = (item, index) => translationOf('items', item.name)?.[1][index] ?? item.anchors[index].words;

/**
 * What to do about a feature that misses its limit.
 * @param {{ rule: string, words: string }} advice
 */
export const adviceText = ({ rule, words }) => translationOf('rules', rule) ?? words;

/** Why a session has no advice. @param {{ reason: string, detail: string }} answer */
export const noAdviceText = ({ reason, detail }) => translationOf('noAdvice', reason) ?? detail;

/** What the quality gate found, with the tool; without a full stop. @param {Schemas['ConcernDocument']} reason */
export function findingText({ name, finding, tool, label, longest, rows, at_s: at, figure, limit }) {
  const translated = translationOf('findings', name)?.[0];
  if (!translated) return finding;
  const toolPrefix = tool ? `${tool}: ` : '';
  const nearest = label ? translations.nearest(label) : '';
  const stretch = longest ? translations.longest(longest) : '';
  const place = rows ? translations.rows(rows) : '';
  const moment = typeof at === 'number' ? translations.moment(at) : '';
  return `${toolPrefix}${translated(figure, limit)}${nearest}${stretch}${place}${moment}`;
}

/** What to do about a finding; without a full stop. The third text, if there is one, is for a tool without tape. */
export function findingAdvice({ name, advice, is_bare: isBare }) {
  const [, general, ofBare] = translationOf('findings', name) ?? [];
  return (isBare && ofBare) || general || advice;
}

/** A reason against a colour, as `{ text, lang }`. Versions learned earlier have no causes. */
export function colourReason(reason, cause) {
  const text = cause && translationOf('colours', cause.fault)?.(cause);
  return text ? { text, lang: undefined } : { text: reason, lang: serviceLang };
}

/**
 * Why a feature has no value, as `{ text, lang }`; an empty text where the service gives no reason. Words of other programs
 * have no code.
 *
 * @param {{ not_enough?: string | null, not_enough_reason?: { code: string, numbers: number[] } | null }} feature
 */
export function notEnoughText({ not_enough: sentence, not_enough_reason: reason }) {
  const text = reason && translationOf('notEnough', reason.code)?.(...reason.numbers);
  return text ? { text, lang: undefined } : { text: sentence ?? '', lang: sentence ? serviceLang : undefined };
}

/**
 * Why the error bar of a value is not known. Words of other programs have no code.
 *
 * @param {{ no_error?: string | null, no_error_reason?: string | null }} feature
 */
export const noErrorBarText = ({ no_error: sentence, no_error_reason: code }) => (code && translationOf('noErrorBar', code)) || sentence;

/** What a self-test found about a part, as `{ text, lang }`. */
export function selfTestFinding(part, test) {
  const text = translationOf('selfTest', `${part.part} ${part.unit}`)?.(part, test);
  return text ? { text, lang: undefined } : { text: part.finding, lang: serviceLang };
}

/** What to do about a part of a self-test, as `{ text, lang }`; the text is empty where there is nothing to do. */
export function selfTestAdvice({ advice, advice_name: name }) {
  const text = translationOf('selfTestAdvice', name);
  return text ? { text, lang: undefined } : { text: advice, lang: serviceLang };
}

/**
 * What is wrong with the value of a field, as `{ text, lang }`.
 *
 * @param {{ message: string }} error
 */
export function fieldErrorText({ message }) {
  for (const [name, pattern] of INVALID_VALUES) {
    const found = message.match(pattern);
    if (found) return { text: translations.invalid[name](...found.slice(1)), lang: undefined };
  }
  const text = conflictText(message);
  return text ? { text, lang: undefined } : { text: message, lang: serviceLang };
}

/** Why something is not possible now; undefined if the sentence has no translation. @param {string} sentence */
function conflictText(sentence) {
  const found = translations.conflicts && findSentence(CONFLICTS, sentence);
  if (!found) return undefined;
  const { name, captured } = found;
  if (name !== REFUSED_BY_BOX) return translations.conflicts[name](...captured);
  const why = boxRefusalText(captured[0]);
  return why && translations.conflicts[name](why);
}

/** Why the agent of a box refuses, in the words of its screen; undefined if another version of the agent says it otherwise. */
function boxRefusalText(why) {
  const found = findSentence(BOX_REFUSALS, why);
  if (!found) return undefined;
  const { refusedFor, details } = t.boxScreen;
  const [detail] = found.captured;
  return detail ? `${refusedFor[found.name]} ${details}: ${detail}.` : refusedFor[found.name];
}

/** The code of a problem is in `type` for a response and in `slug` for a job. The page's own problems have none. */
const problemCode = ({ slug, type }) => slug ?? (type?.startsWith(PROBLEM) ? type.slice(PROBLEM.length) : undefined);

/** What happened. */
export const problemTitle = problem => translationOf('problems', problemCode(problem))?.[0] ?? problem.title;

/** What to do, as `{ text, lang }`. The translation may depend on other members of the problem. */
export function problemDetail(problem) {
  const code = problemCode(problem);
  const translated = translationOf('problems', code)?.[1];
  const text = (typeof translated === 'function' ? translated(problem) : translated) || invalidDetail(problem)
    || (CONFLICT_CODES.includes(code) && conflictText(problem.detail));
  return text ? { text, lang: undefined } : { text: problem.detail, lang: code && serviceLang };
}

/** All that is wrong with the values of a request, if every sentence has a translation. */
function invalidDetail(problem) {
  if (problemCode(problem) !== 'invalid' || !problem.errors?.length) return undefined;
  const texts = problem.errors.map(fieldErrorText);
  return texts.every(({ lang }) => lang === undefined) ? [...new Set(texts.map(({ text }) => text))].join(' ') : undefined;
}
