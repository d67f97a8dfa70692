// Numbers, times and sizes as people read them, in the page's language; times in the zone of the person's device.
import { language, region } from './texts.js';

const when = new Intl.DateTimeFormat(region, { dateStyle: 'medium', timeStyle: 'short' });
const day = new Intl.DateTimeFormat(region, { dateStyle: 'medium' });
/** A day of the calendar is the same everywhere, whatever the zone of the device. */
const calendar = new Intl.DateTimeFormat(region, { dateStyle: 'medium', timeZone: 'UTC' });
const share = new Intl.NumberFormat(language, { style: 'percent', maximumFractionDigits: 1 });
const plain = [0, 1, 2, 3].map(
  digits => new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits }),
);
const rounded = new Intl.NumberFormat(language, { maximumSignificantDigits: 3 });
const telling = new Intl.NumberFormat(language, { maximumSignificantDigits: 2 });
const whole = new Intl.NumberFormat(language, { maximumFractionDigits: 20, useGrouping: false });
const [, POINT] = plain[1].format(0.5);
const TRUE_MINUS = '−';

/** Three telling digits and no more: what follows is noise of the measurement. */
export function number(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 10_000) return minus(plain[0].format(value)); // Counts are exact.
  if (size !== 0 && (size < 0.1 || size >= 10_000)) return minus(rounded.format(value));
  return minus(plain[size >= 100 ? 0 : size >= 10 ? 1 : 2].format(value));
}

/** All digits that it has: for the steps of an axis. */
export const exact = value => minus(whole.format(value));

/** Numbers that stand beside each other, all with so many digits after the point. */
export function withDigits(digits) {
  const format = new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
  return value => minus(format.format(value));
}

/** An error: two telling digits. */
export const uncertain = value => (Number.isFinite(value) ? telling.format(value) : '–');

/** A fixed number of digits after the point: for read-outs, which must not jump in width. */
export function fixed(value, digits) {
  return Number.isFinite(value) ? minus(plain[digits].format(value)) : '–';
}

/** What rounds to nothing has no sign: a tip near zero would flicker between 0.0 and −0.0. */
const minus = text => text.replace('-', /[1-9]/.test(text) ? TRUE_MINUS : '');

export const percent = value => share.format(value);

/** `1` and the empty unit are ratios: nothing is written behind them. */
export const unit = name => (name === '1' || !name ? '' : name);

export const dateTime = iso => (iso ? when.format(new Date(iso)) : '–');
export const date = iso => (iso ? day.format(new Date(iso)) : '–');
/** Of a day without a time, as `2026-01-05`. */
export const calendarDay = iso => calendar.format(new Date(`${iso}T00:00:00Z`));

/** Seconds as `1:02.3`, or `1:02:03.4` from an hour on, with the language's point. */
export function clock(seconds, digits = 1) {
  if (!Number.isFinite(seconds)) return '–';
  const unit = 10 ** digits;
  const total = Math.round(Math.max(0, seconds) * unit) / unit;
  const hours = Math.floor(total / 3600);
  const minutes = Math.floor((total % 3600) / 60);
  const rest = (total % 60).toFixed(digits).replace('.', POINT).padStart(digits ? digits + 3 : 2, '0');
  return hours ? `${hours}:${String(minutes).padStart(2, '0')}:${rest}` : `${minutes}:${rest}`;
}

export function bytes(count) {
  const units = ['B', 'kB', 'MB', 'GB'];
  const step = Math.min(units.length - 1, Math.floor(Math.log10(Math.max(1, count)) / 3));
  return `${step ? plain[1].format(count / 1000 ** step) : count} ${units[step]}`;
}
