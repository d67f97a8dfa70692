// Choosing the tool or hand of a feature. Hands are offered, because the name of a tool holds in one box only. A field of
// a form holds the choice as one text: `hand:left`, the name of a tool, or nothing for the whole session.
import { t } from '../../texts.js';

const PREFIX = 'hand:';
/** @type {('dominant' | 'other' | 'left' | 'right')[]} */
const HANDS = ['dominant', 'other', 'left', 'right'];

/** The hand of this name; undefined if there is none. */
export const handOfName = name => HANDS.find(hand => hand === name);

/**
 * The field's text for a feature of a tool or hand.
 *
 * @param {{ tool?: string | null, in_hand?: string | null }} feature
 */
export const handOrTool = ({ tool, in_hand: hand }) => (hand ? PREFIX + hand : tool ?? '');

/** The field's text as the REST API takes it. */
export const handOrToolQuery = chosen =>
  chosen.startsWith(PREFIX) ? { in_hand: handOfName(chosen.slice(PREFIX.length)) } : { tool: chosen || undefined };

/** Whether values of the chosen tool or hand are compared only among people of one preferred hand. */
export const needsPreference = chosen => chosen !== '' && !['dominant', 'other'].some(hand => chosen === PREFIX + hand);

/**
 * The choices for a feature: the whole session, if it has such a value, then the hands. A tool is offered only where it
 * is chosen already.
 */
export function handChoices(feature, chosen) {
  const first = feature?.of_session ? [['', t.standardForm.whole]] : [['', t.target.choose]];
  const hands = HANDS.map(hand => [PREFIX + hand, t.hands[hand]]);
  const tool = chosen && !chosen.startsWith(PREFIX) ? [[chosen, t.standardForm.onlyTool(chosen)]] : [];
  return [...first, ...hands, ...tool];
}
