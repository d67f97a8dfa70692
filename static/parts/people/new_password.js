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

/** Fewest different characters of a password; the service refuses fewer, too. */
const MIN_DIFFERENT = 5;

/**
 * Throws a problem if a password is a few characters repeated.
 *
 * @param {string} password
 */
export function refuseRepeats(password) {
  if (new Set(password).size < MIN_DIFFERENT) throw new Problem({ title: words.repeats, status: 0 });
}

/**
 * The new password of a form with these fields. Throws a problem if its two inputs differ, or if it is a few characters
 * repeated.
 *
 * @param {Record<string, any>} values
 */
export function newPassword({ fresh, again }) {
  if (fresh !== again) throw new Problem({ title: words.differ, status: 0 });
  refuseRepeats(fresh);
  return fresh;
}
