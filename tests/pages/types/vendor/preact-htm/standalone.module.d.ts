// The vendored build holds Preact, its hooks and htm's template tag.
export * from 'preact';
export * from 'preact/hooks';
export const html: (strings: TemplateStringsArray, ...values: unknown[]) => import('preact').VNode;

// A state or a reference that starts empty: JavaScript cannot say at the call what it will hold.
export function useState(initial: null | undefined): [any, (value: any) => void];
export function useState<S>(initial?: S | (() => S)): [S, (value: S | ((before: S) => S)) => void];
export function useRef(initial: null | undefined): { current: any };
export function useRef<T>(initial: T): { current: T };
