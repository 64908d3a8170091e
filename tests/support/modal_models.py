"""What every modal model must do, checked for any of them."""

import pickle

import numpy as np


def assert_batch_is_a_loop(model, parameters):
    """A batch, a loop and a pickled copy of the model give the same bits."""
    batch = pickle.loads(pickle.dumps(model))(parameters)
    for i in range(len(batch.frequencies)):
        one = model({name: value[i : i + 1] for name, value in parameters.items()})
        assert np.array_equal(batch.frequencies[i], one.frequencies[0])
        assert (batch.shapes is None) == (one.shapes is None)
        if one.shapes is not None:
            assert np.array_equal(batch.shapes[i], one.shapes[0])
