// The fields for a new password: typed twice, since it cannot be read.
import { Problem } from '../../api.js';
import { t } from '../../texts.js';

const words = t.account;

export const NEW_PASSWORD_FIELDS = [
  {
    name: 'fresh',
    label: words.fresh,
    type: 'password',
    required: true,
    minlength: 10,
    hint: words.freshHint,
    autocomplete: 'new-password',
  },
  { name: 'again', label: words.again, type: 'password', required: true, autocomplete: 'new-password' },
];

/**
 * The new password of a form with these fields. Throws a problem if its two inputs differ.
 *
 * @param {Record<string, any>} values
 */
export function newPassword({ fresh, again }) {
  if (fresh !== again) throw new Problem({ title: words.differ, status: 0 });
  return fresh;
}
