// The structures of the library as dictionaries, whose keys python/scree/__init__.py explains.
#ifndef SCREE_PYTHON_RECORDS_H
#define SCREE_PYTHON_RECORDS_H

#include <pybind11/pybind11.h>

#include <scree/scree.hpp>

#include <cstdint>
#include <vector>

namespace scree_python {

namespace py = pybind11;

py::dict stats_of(const scree::Scene& scene);
/// All instances as columns.
py::dict instances_of(const scree::Scene& scene);
py::object pick_of(const scree::View& view, uint32_t x, uint32_t y);
py::dict stats_of(const scree::View& view);
std::vector<py::dict> scenes_of(const scree::File& file);
std::vector<py::dict> meshes_of(const scree::File& file);
std::vector<py::dict> materials_of(const scree::File& file);
std::vector<py::dict> cameras_of(const scree::File& file, uint32_t scene);

}  // namespace scree_python

#endif
