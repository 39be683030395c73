"""scikit-learn's estimator interface: parameters, clones, tags, probabilities."""

from typing import Any, Self

import numpy as np

from eskin.golden.core import InputError, Record


class Estimator:
    """The words that scikit-learn's tools ask a classifier for; scikit-learn itself is loaded by ``tags``
    alone.

    A class that has them keeps its parameters in ``_parameters``.
    """

    _parameters: Record

    def get_params(self, deep: bool = True) -> Record:
        """The parameters as they were given; ``deep`` says nothing here, no parameter has its own."""
        return dict(self._parameters)

    def set_params(self, **parameters: Any) -> Self:
        """Other parameters for the next `fit`.

        Raises
        ------
        InputError
            One that there is not; all are as before then. `fit` refuses wrong values.
        """
        if unknown := sorted(set(parameters) - set(self._parameters)):
            raise InputError(
                f"model: has no parameter '{unknown[0]}'; it has {', '.join(sorted(self._parameters))}"
            )
        self._parameters = self._parameters | parameters
        return self

    def __sklearn_tags__(self) -> Any:
        """A classifier of recordings of any length, which a two-dimensional array of features is not."""
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True),
            classifier_tags=ClassifierTags(),
            input_tags=InputTags(two_d_array=False, three_d_array=True),
            no_validation=True,
        )


def probabilities(scores: np.ndarray, *, votes: bool) -> np.ndarray:
    """Shares of ``scores`` (n, C) that add up to 1: of votes their shares, else exp(score) over the sum of
    all; rows that are not a number give equal shares."""
    finite = np.where(np.isnan(scores), 0.0, scores)
    if votes:
        shares = finite + (finite.sum(axis=1, keepdims=True) == 0)
    else:
        shares = np.exp(finite - finite.max(axis=1, keepdims=True))
    return shares / shares.sum(axis=1, keepdims=True)
