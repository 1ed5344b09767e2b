"""What pyproject.toml cannot say: conf/ at the top of the repository is the folder frictionpinn/conf of a wheel."""

from setuptools import find_namespace_packages, setup

setup(
    packages=[*find_namespace_packages(include=["frictionpinn*", "hydra_plugins*"]), "frictionpinn.conf"],
    package_dir={"frictionpinn.conf": "conf"},
)
