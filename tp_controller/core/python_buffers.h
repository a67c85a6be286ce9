// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Arrays, references and types of Python, through its limited API.
// Reference: none

#pragma once

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <chrono>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <new>
#include <utility>

namespace {

// Larger arrays are left to the reference (tp_controller/solver/compiled.py).
constexpr Py_ssize_t MOST = 1000;

// A reference that is given back.
class Held {
 public:
  explicit Held(PyObject *object) : object_(object) {}
  Held(const Held &) = delete;
  ~Held() { Py_XDECREF(object_); }
  operator PyObject *() const { return object_; }
  PyObject *release() { return std::exchange(object_, nullptr); }

 private:
  PyObject *object_;
};

inline bool is_double(const Py_buffer &view) {
  return view.format && view.format[0] == 'd' && view.format[1] == '\0';
}

// An array of doubles that Python owns.
class Buffer {
 public:
  // `most`: its largest extent.
  explicit Buffer(PyObject *object, int flags = PyBUF_STRIDES | PyBUF_FORMAT,
                  Py_ssize_t most = MOST) {
    if (!object || PyObject_GetBuffer(object, &view_, flags) != 0) {
      PyErr_Clear();
      return;
    }
    held_ = true;
    fits_ = is_double(view_);
    for (int d = 0; fits_ && d < view_.ndim; ++d) fits_ = view_.shape[d] <= most;
  }
  Buffer(const Buffer &) = delete;
  ~Buffer() {
    if (held_) PyBuffer_Release(&view_);
  }

  bool is_number() const { return fits_ && view_.ndim == 0; }
  bool is(Py_ssize_t size) const { return fits_ && view_.ndim == 1 && view_.shape[0] == size; }
  bool is(Py_ssize_t rows, Py_ssize_t columns) const {
    return fits_ && view_.ndim == 2 && view_.shape[0] == rows && view_.shape[1] == columns;
  }
  // How long it is; −1 where it is none of so many dimensions.
  Py_ssize_t rows(int dimensions) const {
    return fits_ && view_.ndim == dimensions ? view_.shape[0] : -1;
  }

  Py_ssize_t columns() const { return view_.shape[1]; }

  double number() const { return number(0); }
  double at(Py_ssize_t i) const { return number(i * view_.strides[0]); }
  double at(Py_ssize_t i, Py_ssize_t j) const {
    return number(i * view_.strides[0] + j * view_.strides[1]);
  }

  void copy(double *to) const {
    for (Py_ssize_t i = 0; i < view_.shape[0]; ++i) to[i] = at(i);
  }

  void copy_rows(double *to) const {
    const Py_ssize_t columns = view_.shape[1];
    for (Py_ssize_t i = 0; i < view_.shape[0]; ++i)
      for (Py_ssize_t j = 0; j < columns; ++j)
        to[i * columns + j] = at(i, j);
  }

  void fill(const double *from) const {
    for (Py_ssize_t i = 0; i < view_.shape[0]; ++i)
      std::memcpy(static_cast<char *>(view_.buf) + i * view_.strides[0], from + i, sizeof(double));
  }

 private:
  double number(Py_ssize_t offset) const {
    double found;
    std::memcpy(&found, static_cast<const char *>(view_.buf) + offset, sizeof(double));
    return found;
  }

  bool held_ = false;

 protected:
  Py_buffer view_;
  bool fits_ = false;
};

// Read booleans (size,) as numbers 0 and 1; false where they are none.
inline bool read_mask(PyObject *object, Py_ssize_t size, double *found) {
  Py_buffer view;
  if (PyObject_GetBuffer(object, &view, PyBUF_STRIDES | PyBUF_FORMAT) != 0) {
    PyErr_Clear();
    return false;
  }
  const bool fits = view.format && view.format[0] == '?' && view.format[1] == '\0'
      && view.ndim == 1 && view.shape[0] == size;
  for (Py_ssize_t i = 0; fits && i < size; ++i)
    found[i] = static_cast<const char *>(view.buf)[i * view.strides[0]] ? 1.0 : 0.0;
  PyBuffer_Release(&view);
  return fits;
}

// An array of doubles, in the order of C, that is filled in.
class Output : public Buffer {
 public:
  explicit Output(PyObject *object, Py_ssize_t most = MOST)
      : Buffer(object, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | PyBUF_WRITABLE, most) {
    fits_ = fits_ && reinterpret_cast<std::uintptr_t>(view_.buf) % alignof(double) == 0;
  }

  double *p() const { return static_cast<double *>(view_.buf); }
};

// An object of Python that holds one of C++.
template <typename Value>
struct Object {
  PyObject_HEAD
  Value *value;
};

template <typename Value>
Value &of(PyObject *self) {
  return *reinterpret_cast<Object<Value> *>(self)->value;
}

// The type of objects that hold such values; `make_type` sets it.
template <typename Value>
PyTypeObject *TYPE_OF = nullptr;

// What an object of Python holds; none where it is of another type.
template <typename Value>
Value *find(PyObject *object) {
  return object && PyObject_TypeCheck(object, TYPE_OF<Value>) ? &of<Value>(object) : nullptr;
}

// A new object of a type, its value made of some arguments.
template <typename Value, typename... Arguments>
PyObject *keep(PyTypeObject *type, Arguments &&...arguments) {
  const auto allocate = reinterpret_cast<allocfunc>(PyType_GetSlot(type, Py_tp_alloc));
  PyObject *self = allocate(type, 0);
  if (!self) return nullptr;
  Value *&value = reinterpret_cast<Object<Value> *>(self)->value;
  value = new (std::nothrow) Value(std::forward<Arguments>(arguments)...);
  if (value) return self;
  Py_DECREF(self);
  return PyErr_NoMemory();
}

template <typename Value>
void destroy(PyObject *self) {
  PyTypeObject *type = Py_TYPE(self);
  delete reinterpret_cast<Object<Value> *>(self)->value;
  reinterpret_cast<freefunc>(PyType_GetSlot(type, Py_tp_free))(self);
  Py_DECREF(type);
}

template <typename Value>
PyObject *make_type(const char *name, newfunc make, PyMethodDef *methods) {
  PyType_Slot slots[] = {
      {Py_tp_new, reinterpret_cast<void *>(make)},
      {Py_tp_dealloc, reinterpret_cast<void *>(destroy<Value>)},
      {Py_tp_methods, methods},
      {0, nullptr}};
  PyType_Spec spec = {name, sizeof(Object<Value>), 0, Py_TPFLAGS_DEFAULT, slots};
  PyObject *type = PyType_FromSpec(&spec);
  TYPE_OF<Value> = reinterpret_cast<PyTypeObject *>(type);
  return type;
}

// Lets other threads of Python run meanwhile, if the work is long. After a short one, waiting for
// their turn to end would take longer than the work: two threads would get less done than one.
class WithoutPython {
 public:
  using Clock = std::chrono::steady_clock;

  // `took`: time of the same work when it was last done, and afterwards of this time.
  explicit WithoutPython(Clock::duration &took)
      : took_(took), state_(took > SHORT ? PyEval_SaveThread() : nullptr) {}
  WithoutPython(const WithoutPython &) = delete;
  ~WithoutPython() {
    took_ = Clock::now() - began_;
    if (state_) PyEval_RestoreThread(state_);
  }

 private:
  static constexpr std::chrono::microseconds SHORT{5};

  Clock::duration &took_;
  const Clock::time_point began_ = Clock::now();
  PyThreadState *state_;
};

// A method that gets its arguments as an array.
PyMethodDef method(const char *name, PyObject *(*function)(PyObject *, PyObject *const *, Py_ssize_t),
                   const char *what) {
  return {name, reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)(void)>(function)),
          METH_FASTCALL, what};
}

// A name of an attribute, made once; false where there is no memory.
bool intern(PyObject *&name, const char *text) {
  name = PyUnicode_InternFromString(text);
  return name != nullptr;
}

// A module that takes objects by name; none where one of them could not be made.
PyObject *make_module(PyModuleDef &definition,
                      std::initializer_list<std::pair<const char *, PyObject *>> objects) {
  Held module(PyModule_Create(&definition));
  for (const auto &each : objects)
    if (!module || !each.second || PyModule_AddObject(module, each.first, each.second) != 0)
      return nullptr;
  return module.release();
}

}  // namespace
