// Where the model cannot be drawn: a sentence and the still picture that the page holds, never a blank page.
export function fallBack(reason) {
  document.documentElement.classList.add("still");
  document.getElementById("sentence").textContent =
    `This browser cannot draw the model (${reason}). The picture is a still; ` +
    "a browser with WebGL2, of 2023 or later, shows the model from all sides.";
}
