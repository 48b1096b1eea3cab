// Unpacks the Chromium of @sparticuz/chromium beside this file and prints the path of a launcher for it.

import { chmodSync, existsSync, mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";

const folder = join(import.meta.dirname, "unpacked");
mkdirSync(folder, { recursive: true });

// The package unpacks into the temporary folder, and its shared libraries and fonts only where it believes to be on the
// system that they were taken from. Both are read when it is imported.
process.env.TMPDIR = folder;
process.env.AWS_EXECUTION_ENV = "nodejs20.x";
const { default: chromium } = await import("@sparticuz/chromium");
const binary = await chromium.executablePath();

const launcher = join(import.meta.dirname, "chromium");
const fonts = existsSync("/etc/fonts/fonts.conf") ? "" : `export FONTCONFIG_PATH='${join(folder, "fonts")}'\n`;
writeFileSync(
  launcher,
  `#!/bin/sh
${fonts}LD_LIBRARY_PATH="\${LD_LIBRARY_PATH:+$LD_LIBRARY_PATH:}"'${join(folder, "al2023", "lib")}'
export LD_LIBRARY_PATH
exec '${binary}' "$@"
`,
);
chmodSync(launcher, 0o755);
console.log(launcher);
