// The groups whose instructors may change a box, a task or a course plan.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';
import { Notice } from '../page/notice.js';

const words = t.owners;

/** The groups that the person may choose from; none for people who change nothing. @param {Schemas['Me']} person */
export const ownerGroups = async person => (may(person, 'edit_boxes') ? api.groups.all() : []);

/**
 * The form's field for them. A new thing of an instructor belongs to all of the instructor's groups.
 *
 * @param {Schemas['GroupResponse'][]} groups @param {{ groups: string[] } | null} item @param {Schemas['Me']} person
 */
export function ownersField(groups, item, person) {
  if (!groups.length) return [];
  const isAdministrator = may(person, 'people');
  const options = groups.map(group => [group.id, group.name]);
  const value = item?.groups ?? (isAdministrator ? [] : groups.map(group => group.id));
  const hint = isAdministrator ? words.hint : words.ownHint;
  return [{ name: 'groups', label: words.label, hint, type: 'checks', options, value }];
}

/** Says why there is nothing to change here. */
export const NotYours = () => html`<${Notice} title=${words.notYours}>${words.notYoursBody}<//>`;
