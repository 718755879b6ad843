"""Registers dsdf as a method of nerfbaselines, and metrics that need no PyTorch.

nerfbaselines finds this file by the entry point of the package, by the variable
``NERFBASELINES_REGISTER``, or after ``nerfbaselines install --spec``.
"""

import pathlib
import shlex

from nerfbaselines import EvaluationProtocolSpec, MethodSpec, register

#: The folder of the package. For a file of a clone, the clone has dsdf, too.
INTEGRATION = pathlib.Path(__file__).resolve().parents[1]
CLONE = INTEGRATION.parents[1]

#: dsdf is in no package index: a wheel, whose path is in DSDF_WHEEL, or a clone has it. The first
#: line has what nerfbaselines needs, which is linked into the environment afterwards, and what its
#: metrics need.
INSTALL = f"""
pip install 'numpy<2' scipy opencv-python-headless Pillow matplotlib plyfile tqdm click \\
  tensorboard typing_extensions torch torchvision
INTEGRATION={shlex.quote(str(INTEGRATION))}
CLONE={shlex.quote(str(CLONE))}
if [ -n "$DSDF_WHEEL" ]; then
  pip install "$DSDF_WHEEL"
elif [ -f "$CLONE/crates/python/pyproject.toml" ]; then
  pip install "$CLONE/crates/python"
else
  echo 'error: DSDF_WHEEL: found nothing, expected the path of a wheel of dsdf' >&2
  exit 1
fi
if [ ! -f "$INTEGRATION/pyproject.toml" ]; then
  echo "error: $INTEGRATION: found no package, expected this spec in a clone of dsdf" >&2
  exit 1
fi
pip install --no-deps "$INTEGRATION"
"""

DSDF: MethodSpec = {
    "id": "dsdf",
    "method_class": "dsdf_nerfbaselines.method:Dsdf",
    "conda": {
        "environment_name": "dsdf",
        "python_version": "3.11",
        "install_script": INSTALL,
    },
    "metadata": {
        "name": "dsdf",
        "description": "Differentiable rendering of a neural signed distance field, with exact "
        "gradients of silhouettes. It runs on processors alone, and gives a mesh.",
        "licenses": [{"name": "MIT OR Apache-2.0"}],
    },
    # Those of `dsdf fit --preset`.
    "presets": {
        "fast": {"iterations": 2000},
        "accurate": {"iterations": 20000, "width": 96},
    },
}

PSNR_SSIM: EvaluationProtocolSpec = {
    "id": "psnr-ssim",
    "evaluation_protocol_class": "dsdf_nerfbaselines.offline:PsnrSsim",
}

register(DSDF)
register(PSNR_SSIM)
