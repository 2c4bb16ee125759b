// eslint of the page's modules, and of the scripts that tests run in a page.

const browser = [
  "Blob",
  "CustomEvent",
  "DOMMatrix",
  "DOMPoint",
  "DecompressionStream",
  "Event",
  "KeyboardEvent",
  "MouseEvent",
  "PointerEvent",
  "ResizeObserver",
  "Response",
  "TextDecoder",
  "URL",
  "URLSearchParams",
  "WebAssembly",
  "atob",
  "XMLSerializer",
  "addEventListener",
  "console",
  "document",
  "fetch",
  "dispatchEvent",
  "getComputedStyle",
  "history",
  "innerHeight",
  "innerWidth",
  "location",
  "matchMedia",
  "navigator",
  "performance",
  "requestAnimationFrame",
  "setInterval",
  "setTimeout",
  "window",
];

const rules = {
  curly: ["error", "multi-line"],
  eqeqeq: "error",
  "max-lines-per-function": ["error", { max: 60, skipComments: true }],
  "no-redeclare": "error",
  "no-sequences": "error",
  "no-shadow": "error",
  "no-undef": "error",
  "no-unused-vars": "error",
  "no-var": "error",
  "one-var": ["error", "never"],
  "prefer-const": "error",
};

const globalsOf = (names) => Object.fromEntries(names.map((name) => [name, "readonly"]));

// Scripts of tests see the top level of the page's script.
const page = [
  "$",
  "armAt",
  "axe",
  "chosen",
  "endDrive",
  "errors",
  "linkOfState",
  "make",
  "motionInWords",
  "range",
  "scopesAsSvg",
  "scoreLine",
  "sentenceOf",
  "setCursor",
  "shownLoop",
  "signalsAsCsv",
  "state",
  "strip",
  "takeGuess",
  "teleop",
  "toggleDrive",
  "zoom",
];

export default [
  {
    files: ["teleop_drake/page/js/*.js"],
    languageOptions: { sourceType: "module", globals: globalsOf(browser) },
    rules,
  },
  {
    files: ["tests/page/*.js"],
    languageOptions: { sourceType: "script", globals: globalsOf([...browser, ...page]) },
    rules: { ...rules, "no-redeclare": "off", "no-unused-vars": ["error", { vars: "local" }] },
  },
];
