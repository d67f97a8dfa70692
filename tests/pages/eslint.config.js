// The recommended rules, and some that find slips which `tsc` accepts.
import js from '@eslint/js';
import globals from 'globals';

/** Names that a window has: where one of them is used alone, a variable was meant. */
const WINDOW_NAMES = [
  'name', 'event', 'length', 'status', 'top', 'parent', 'origin', 'close', 'find', 'open', 'stop', 'self',
];

export default [
  { ignores: ['**/vendor/**'] },
  {
    files: ['**/*.js'],
    languageOptions: { sourceType: 'module', globals: { ...globals.browser, ...globals.worker } },
    linterOptions: { reportUnusedDisableDirectives: 'error' },
    rules: {
      ...js.configs.recommended.rules,
      'no-unused-vars': ['error', { ignoreRestSiblings: true }],
      'no-restricted-globals': ['error', ...WINDOW_NAMES],
      'no-shadow': 'error',
      eqeqeq: 'error',
    },
  },
];
