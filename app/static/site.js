// Comforts on top of pages that work without script: copy buttons, a menu that closes, progress that moves.
"use strict";

const FINAL = new Set(["scored", "rejected", "failed", "cancelled", "withdrawn", "held"]);

function offerCopy(pre) {
  if (!navigator.clipboard) return; // browsers offer it on https and localhost only
  const button = document.createElement("button");
  button.type = "button";
  button.className = "copy";
  button.textContent = "Copy";
  button.setAttribute("aria-live", "polite");
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText(pre.textContent);
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  });
  pre.after(button);
}

function closeWhenLeft(menu) {
  document.addEventListener("click", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("focusout", (event) => {
    if (event.relatedTarget && !menu.contains(event.relatedTarget)) menu.open = false;
  });
  menu.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !menu.open) return;
    menu.open = false;
    menu.querySelector("summary").focus();
  });
}

// A screen reader speaks each change, so a live text changes every tenth only.
function say(element, text, done, total) {
  const words = total ? `${text}, ${Math.floor((10 * done) / total) * 10}%` : text;
  if (element.textContent !== words) element.textContent = words;
}

function follow(panel) {
  const bar = panel.querySelector("[data-bar]");
  let wait = 1000;
  let seen = "";

  async function ask() {
    try {
      const answer = await fetch(panel.dataset.live, { headers: { Accept: "application/json" } });
      if (answer.ok) {
        const submission = await answer.json();
        if (FINAL.has(submission.state)) return location.reload();
        const { done = 0, total = 0 } = submission.progress ?? {};
        say(panel.querySelector("[data-status]"), submission.state_text ?? submission.state, done, total);
        if (total) {
          bar.max = total;
          bar.value = done;
          panel.querySelector("[data-frames]").textContent = `${done} of ${total} frames`;
        }
        const now = `${submission.state} ${done}`;
        wait = now === seen ? Math.min(wait * 1.5, 5000) : 1000;
        seen = now;
      } else {
        wait = 5000;
      }
    } catch {
      wait = 5000; // the network may come back
    }
    setTimeout(ask, wait);
  }
  setTimeout(ask, wait);
}

// The server answers a refused form with a page: show its main part here and keep the chosen file.
function showAnswer(request, form) {
  const page = new DOMParser().parseFromString(request.responseText, "text/html");
  const main = page.querySelector("main");
  if (!main) return false;
  main.querySelector("input[type=file]")?.replaceWith(form.elements.file);
  document.querySelector("main").replaceWith(main);
  document.title = page.title;
  enhance(main);
  (main.querySelector("[role=alert]") ?? main).focus();
  return true;
}

function uploadWithProgress(form) {
  const panel = form.querySelector("[data-upload-progress]");
  const bar = panel.querySelector("progress");
  const bytes = panel.querySelector("[data-bytes]");
  const button = form.querySelector("button[type=submit]");

  function stop(text) {
    bytes.textContent = text;
    bar.hidden = true;
    button.disabled = false;
    panel.querySelector("[role=status]").textContent = text;
  }

  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const request = new XMLHttpRequest();
    request.upload.addEventListener("progress", ({ loaded, total }) => {
      bar.value = (100 * loaded) / total;
      bytes.textContent = `${(loaded / 1e6).toFixed(1)} of ${(total / 1e6).toFixed(1)} MB`;
      say(panel.querySelector("[role=status]"), "Uploading", loaded, total);
    });
    request.addEventListener("load", () => {
      if (request.status < 400) location.assign(request.responseURL);
      else if (!showAnswer(request, form)) stop(`${request.status}: ${request.responseText || request.statusText}`);
    });
    request.addEventListener("error", () => stop("The connection broke before the upload was complete. Try again."));
    panel.hidden = false;
    bar.hidden = false;
    button.disabled = true;
    request.open("POST", form.action);
    request.send(new FormData(form));
  });
}

function enhance(root) {
  root.querySelectorAll("[data-copy]").forEach(offerCopy);
  root.querySelectorAll("details.menu").forEach(closeWhenLeft);
  root.querySelectorAll("[data-live]").forEach(follow);
  root.querySelectorAll("form[data-upload]").forEach(uploadWithProgress);
}

enhance(document);
