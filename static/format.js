// Numbers, times and sizes in the page's language; times in the time zone of the device.
import { language, region } from './texts.js';

const dateTimeFormat = new Intl.DateTimeFormat(region, { dateStyle: 'medium', timeStyle: 'short' });
const dateFormat = new Intl.DateTimeFormat(region, { dateStyle: 'medium' });
/** A calendar day is the same in every time zone. */
const calendarFormat = new Intl.DateTimeFormat(region, { dateStyle: 'medium', timeZone: 'UTC' });
const percentFormat = new Intl.NumberFormat(language, { style: 'percent', maximumFractionDigits: 1 });
const fixedFraction = [0, 1, 2, 3].map(
  digits => new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits }),
);
const threeSignificant = new Intl.NumberFormat(language, { maximumSignificantDigits: 3 });
const twoSignificant = new Intl.NumberFormat(language, { maximumSignificantDigits: 2 });
const unrounded = new Intl.NumberFormat(language, { maximumFractionDigits: 20, useGrouping: false });
const [, POINT] = fixedFraction[1].format(0.5);
const TRUE_MINUS = '−';

/** Three significant digits: further digits are noise of the measurement. */
export function number(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  // Counts are exact.
  if (Number.isInteger(value) && size < 10_000) return withTrueMinus(fixedFraction[0].format(value));
  if (size !== 0 && (size < 0.1 || size >= 10_000)) return withTrueMinus(threeSignificant.format(value));
  return withTrueMinus(fixedFraction[size >= 100 ? 0 : size >= 10 ? 1 : 2].format(value));
}

/** All digits of a value: for the steps of an axis. */
export const exact = value => withTrueMinus(unrounded.format(value));

/** A format for numbers that are shown side by side, all with the same number of decimal places. */
export function withDigits(digits) {
  const format = new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
  return value => withTrueMinus(format.format(value));
}

/** An error, with two significant digits. */
export const uncertainty = value => (Number.isFinite(value) ? twoSignificant.format(value) : '–');

/** A fixed number of decimal places: for readouts, whose width must not change. */
export function fixed(value, digits) {
  return Number.isFinite(value) ? withTrueMinus(fixedFraction[digits].format(value)) : '–';
}

/** A value that rounds to zero has no sign: a tip near zero would flicker between 0.0 and −0.0. */
const withTrueMinus = text => text.replace('-', /[1-9]/.test(text) ? TRUE_MINUS : '');

export const percent = value => percentFormat.format(value);

/** Empty for `1`, the unit of shares, counts and ratios, and where nothing was measured. */
export const unit = name => (name === '1' || !name ? '' : name);

/** No line breaks within a date: a list of dates would be read wrongly. */
const unbroken = text => text.replaceAll(' ', '\u00a0');

/** A line may break between date and time. */
export function dateTime(iso) {
  if (!iso) return '–';
  const [day, both] = [dateFormat, dateTimeFormat].map(format => format.format(new Date(iso)));
  return both.startsWith(day) ? unbroken(day) + both.slice(day.length) : both;
}
export const date = iso => (iso ? unbroken(dateFormat.format(new Date(iso))) : '–');
/** Formats a day without a time, such as `2026-01-05`. */
export const calendarDay = iso => unbroken(calendarFormat.format(new Date(`${iso}T00:00:00Z`)));

/** Seconds as `1:02.3`, or `1:02:03.4` from an hour on, with the language's decimal separator. */
export function clock(seconds, digits = 1) {
  if (!Number.isFinite(seconds)) return '–';
  const perSecond = 10 ** digits;
  const total = Math.round(Math.max(0, seconds) * perSecond) / perSecond;
  const hours = Math.floor(total / 3600);
  const minutes = Math.floor((total % 3600) / 60);
  const rest = (total % 60).toFixed(digits).replace('.', POINT).padStart(digits ? digits + 3 : 2, '0');
  return hours ? `${hours}:${String(minutes).padStart(2, '0')}:${rest}` : `${minutes}:${rest}`;
}

export function bytes(count) {
  const units = ['B', 'kB', 'MB', 'GB'];
  const step = Math.min(units.length - 1, Math.floor(Math.log10(Math.max(1, count)) / 3));
  return `${step ? fixedFraction[1].format(count / 1000 ** step) : count} ${units[step]}`;
}
